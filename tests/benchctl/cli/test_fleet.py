"""`benchctl fleet`, as its users run it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from benchctl.cli.app import run_verb
from benchctl.cli.completing import candidates
from tests.benchctl.believed import BELIEVED
from tests.benchctl.cli.processes import benchctl, started
from tests.benchctl.fleet.made import points

LIMITS = '[limits.scale_factor]\nlow = 49.0\nhigh = 51.0\nunit = "mV/(deg/s)"\n'


def told_by(path: Path) -> Any:
    return json.loads(path.read_text())


@pytest.mark.slow
def test_a_fleet_of_good_and_bad_recordings_is_reported_and_the_next_run_does_only_what_is_left(tmp_path: Path) -> None:
    points(tmp_path / "u1.h5", 1)
    points(tmp_path / "u2.h5", 2)
    (tmp_path / "bad.h5").write_text("junk")
    (tmp_path / "README.md").write_text("hello")
    ways = ("fleet", "fit", f"{tmp_path}/**", "--report", tmp_path / "page", "--workers", "2")
    ran = benchctl(*ways, "--json", tmp_path / "fleet.json", timeout_s=120.0)
    assert ran.returncode == 2
    says = (
        f"of 3 recordings 1 could not be done, the first: {tmp_path}/bad.h5: is not an HDF5 file (4 bytes); expected a "
        "recording; import other files (benchctl import)"
    )
    assert ran.stderr == f"benchctl: {says}\n"
    assert ran.stdout.splitlines() == [
        "fit of 3 recordings: 2 done, 0 unchanged since they were done, 1 failed",
        f"failed: {tmp_path}/bad.h5: is not an HDF5 file (4 bytes); expected a recording; import other files "
        "(benchctl import)",
        f"report: {tmp_path}/page/fleet.html",
        f"summary: {tmp_path}/page/fleet.json",
    ]
    told = told_by(tmp_path / "fleet.json")
    assert (told["schema"], told["ok"]) == ("benchctl-fleet/1", False)
    assert told["error"] == says
    assert told["recordings"] == {"total": 3, "done": 2, "kept": 0, "failed": 1, "left": 0}
    assert told_by(tmp_path / "page" / "fleet.json").items() <= told.items()

    (tmp_path / "bad.h5").unlink()
    assert run_verb([*map(str, ways), "--quiet", "--json", str(tmp_path / "fleet.json")]) == 0
    assert told_by(tmp_path / "fleet.json")["recordings"] == {"total": 2, "done": 0, "kept": 2, "failed": 0, "left": 0}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fit", "{}/no*.h5"], "no*.h5: matches nothing"),
        (["fit", "{}"], "no recording there; expected *.h5, campaigns' folders or open recordings'; for all below"),
        (["fits", "{}/*.h5"], "did you mean fit?"),
        (["fit"], "GLOB is needed: paths of recordings, patterns in quotes"),
        (["fit", "{}/*.h5", "--limits", "x.toml"], "fleet fit: there is no option --limits"),
        (["accept", "{}/*.h5", "--seed", "1"], "fleet accept: there is no option --seed"),
        (["accept", "{}/*.h5"], "--limits is needed: the limits, as TOML; `benchctl init` writes an example"),
        (["accept", "{}/*.h5", "--limits", "{}/no.toml"], "no.toml: "),
        (["diagnose", "{}/*.h5", "--model", "{}/no.toml"], "no.toml: "),
        (["fit", "{}/*.h5", "--shceduler", "x"], "there is no option --shceduler: did you mean --scheduler?"),
        (["fit", "{}/*.h5", "--workers", "0"], "--workers: expected a number of at least 1"),
        (["fit", "{}/*.h5", "--workers", "2", "--scheduler", "x"], "--workers: is for this machine"),
        (["fit", "{}/*.h5", "--scheduler", "nosuch://x"], "is no address; expected one such as tcp://"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(
    tmp_path: Path, arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    points(tmp_path / "a.h5", 1)
    assert run_verb(["fleet", *(text.format(tmp_path) for text in arguments), "--report", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.slow
def test_without_the_extra_it_says_what_to_install_and_needs_it_for_work_only(tmp_path: Path) -> None:
    points(tmp_path / "a.h5", 1)
    program = "import sys; sys.modules['dask'] = None; from benchctl.cli.app import run_verb; sys.exit(run_verb({}))"
    ran = subprocess.run(
        [sys.executable, "-c", program.format(["fleet", "fit", f"{tmp_path}/*.h5", "--report", str(tmp_path)])],
        capture_output=True,
        text=True,
    )
    assert (ran.returncode, ran.stdout) == (2, "")
    assert ran.stderr == "benchctl: fleet: needs dask.distributed; pip install 'benchctl[cluster]'\n"


def test_verbs_globs_and_options_are_completed(tmp_path: Path) -> None:
    points(tmp_path / "a.h5", 1)
    assert [text for text, _ in candidates(["fleet"], "d")] == ["diagnose"]
    assert [text for text, _ in candidates(["fleet", "fit"], f"{tmp_path}/")] == [f"{tmp_path}/a.h5"]
    assert [text for text, _ in candidates(["fleet", "fit", "a.h5", "b.h5"], f"{tmp_path}/")] == [f"{tmp_path}/a.h5"]
    assert [text for text, _ in candidates(["fleet", "fit"], "--sch")] == ["--scheduler"]


@pytest.mark.slow
@pytest.mark.parametrize("stopping", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_keeps_what_is_done_and_the_same_command_goes_on(tmp_path: Path, stopping: signal.Signals) -> None:
    for number in range(12):
        points(tmp_path / f"u{number:02d}.h5", number)
    ways = ["fleet", "fit", f"{tmp_path}/*.h5", "--report", str(tmp_path), "--json", str(tmp_path / "told.json")]
    process = subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "benchctl", *ways, "--workers", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while len(list(tmp_path.glob("*.fit"))) < 2:
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, stopping)  # as a terminal does it
    out, err = process.communicate(timeout=60.0)
    assert (process.returncode, err) == (130, "benchctl: stopped\n")
    told = told_by(tmp_path / "told.json")
    left = told["recordings"]["left"]
    assert 1 <= left <= 11  # of two that had landed one may not have been told yet
    assert told["error"] == f"stopped with {left} left; the same command goes on"
    assert f", {left} left" in out.splitlines()[0]
    assert not list(tmp_path.glob(".*"))
    assert run_verb([*ways, "--quiet"]) == 0
    counts = told_by(tmp_path / "told.json")["recordings"]
    assert counts["kept"] >= 12 - left  # what had landed, but was not told yet, is kept, too
    assert counts["done"] + counts["kept"] == 12


@pytest.mark.slow
def test_two_fleets_over_the_same_recordings_at_once_both_end_well(tmp_path: Path) -> None:
    for number in range(6):
        points(tmp_path / f"u{number}.h5", number)
    ways = ["fleet", "fit", f"{tmp_path}/*.h5", "--workers", "1", "--report"]
    with started(*ways, tmp_path / "one") as one, started(*ways, tmp_path / "two") as two:
        ends = [(*process.communicate(timeout=120.0), process.returncode) for process in (one, two)]
    assert [(err, status) for _, err, status in ends] == [("", 0), ("", 0)]
    assert sorted(path.name for path in tmp_path.glob("*.fit")) == [f"u{number}.fit" for number in range(6)]
    assert not list(tmp_path.glob(".*"))
    assert run_verb(["fleet", "fit", f"{tmp_path}/*.h5", "--report", str(tmp_path), "--quiet"]) == 0
    assert told_by(tmp_path / "fleet.json")["recordings"]["kept"] == 6


@pytest.mark.slow
def test_accept_says_what_the_single_verb_says(tmp_path: Path) -> None:
    recording, limits = str(tmp_path / "a.h5"), tmp_path / "limits.toml"
    limits.write_text(LIMITS)
    assert run_verb(["simulate", "rate_sweep", "-o", recording, "--seed", "1", "--quiet"]) == 0
    ways = [recording, "--limits", str(limits), "--quiet"]
    status = run_verb(["fleet", "accept", *ways, "--report", str(tmp_path)])
    assert status == run_verb(["accept", *ways, "--out", str(tmp_path / "one")])
    theirs = told_by(tmp_path / "one" / "acceptance.json")
    assert told_by(tmp_path / "a.acceptance" / "acceptance.json") == theirs
    names = {path.name for path in (tmp_path / "one").iterdir()}
    assert names == {path.name for path in (tmp_path / "a.acceptance").glob("acceptance.*")}
    told = told_by(tmp_path / "fleet.json")
    assert told["members"][0]["verdicts"] == {"accept": theirs["verdict"]}
    assert status == (0 if theirs["verdict"] == "PASS" else 1)
    limits.write_text(LIMITS.replace("51.0", "52.0"))
    run_verb(["fleet", "accept", *ways, "--report", str(tmp_path)])
    assert told_by(tmp_path / "fleet.json")["recordings"]["done"] == 1  # other limits are another question


@pytest.mark.slow
def test_diagnose_says_what_the_single_verb_says_and_the_page_has_the_fits_as_well(tmp_path: Path) -> None:
    points(tmp_path / "a.h5", 1)
    (tmp_path / "lab.toml").write_text(BELIEVED)
    ways = [str(tmp_path / "a.h5"), "--quiet"]
    given = ["--model", str(tmp_path / "lab.toml"), "--seed", "3"]
    assert run_verb(["fleet", "fit", *ways, "--report", str(tmp_path)]) == 0
    assert run_verb(["fleet", "diagnose", *ways, *given, "--report", str(tmp_path)]) == 0
    assert run_verb(["diagnose", *ways, *given, "--out", str(tmp_path / "one")]) == 0
    theirs = told_by(tmp_path / "one" / "diagnosis.json")
    assert told_by(tmp_path / "a.diagnosis" / "diagnosis.json") == theirs
    told = told_by(tmp_path / "fleet.json")
    assert told["members"][0]["verdicts"] == {"diagnose": theirs["verdict"]}
    assert set(told["members"][0]["reports"]) == {"fit", "diagnose"}
    assert [one["name"] for one in told["figures"]][:2] == ["K0_v_per_dps", "U0_v"]
    assert {one["effect"] for one in told["effects"]} == {one["effect"] for one in theirs["findings"]}
