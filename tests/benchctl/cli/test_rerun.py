"""`run --again` as QA meets it: the first run's own file, one command, and what differs."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from benchctl.bench import template
from benchctl.cli.app import run_verb
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.writer import write_recording

SMALL = ("-p", "at_c=23", "-p", "soak_s=60", "-p", "rates=4", "-p", "run_s=8", "-p", "zero_s=10")
BENCH = template().replace("sample_rate_hz = 500.0", "sample_rate_hz = 50.0")
LIMITS = '[limits.scale_factor]\nlow = 46.9\nhigh = 46.98\nunit = "mV/(deg/s)"\n'
GROUPS = {"procedure", "parameters", "bench", "instruments", "software", "operator"}

Again = Callable[..., tuple[int, dict[str, Any], str]]
Refused = Callable[..., str]


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a first run, accepted by its limits."""
    folder = tmp_path_factory.mktemp("rerun")
    (folder / "bench.toml").write_text(BENCH)
    (folder / "limits.toml").write_text(LIMITS)
    arguments = ("run", "hysteresis", "--bench", folder / "bench.toml", *SMALL, "--out", folder / "first", "--quiet")
    assert run_verb(list(map(str, arguments))) == 0
    assert run_verb(["accept", str(folder / "first"), "--limits", str(folder / "limits.toml"), "--quiet"]) == 0
    return folder / "first"


@pytest.fixture
def alone(first: Path, tmp_path: Path) -> Path:
    """The first run's recording, and nothing else, in the current folder."""
    (tmp_path / "first.h5").write_bytes((first / "recording.h5").read_bytes())
    return Path("first.h5")


@pytest.fixture
def again(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Again:
    """Run again in an empty folder: exit status, JSON, and what was said."""
    monkeypatch.chdir(tmp_path)

    def ran(recording: Path, *arguments: str | Path) -> tuple[int, dict[str, Any], str]:
        status = run_verb(["run", "--again", str(recording), "--json", "run.json", *map(str, arguments)])
        return status, json.loads(Path("run.json").read_text()), capsys.readouterr().out

    return ran


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Refused:
    """Run again what must be refused before anything is run; returns its one line."""
    monkeypatch.chdir(tmp_path)

    def refuse(*arguments: str | Path) -> str:
        assert run_verb(["run", *map(str, arguments)]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        (line,) = captured.err.splitlines()
        assert not Path("results").exists()
        return line.removeprefix("benchctl: ")

    return refuse


def test_from_the_file_alone_the_same_unit_differs_in_nothing(again: Again, alone: Path) -> None:
    status, document, said = again(alone)
    assert status == 0
    assert document["schema"] == "benchctl-run/1"
    assert document["status"] == "complete"
    told = document["again"]
    assert told["first"] == "first.h5"
    assert told["differences"] == {name: [] for name in GROUPS}
    assert (told["first_seed"], told["seed"]) == (1, 2)
    tests = {test["name"]: test for test in told["tests"]}
    assert {"scale_factor", "hysteresis_rate", "bias"} <= set(tests)
    assert not any(test["differs"] for test in tests.values())
    scale = tests["scale_factor"]
    assert scale["again"] != scale["first"]  # another day's noise
    assert scale["difference"] == pytest.approx(scale["again"] - scale["first"])
    both = (scale["first_uncertainty"] ** 2 + scale["again_uncertainty"] ** 2) ** 0.5
    assert scale["e_n"] == pytest.approx(scale["difference"] / both)
    assert (scale["first_verdict"], scale["again_verdict"]) == (None, None)
    assert "verdict" not in document
    assert "noise        simulated, drawn anew: seed 2 where the first run had 1" in said
    assert "not judged" in said
    assert max(map(len, said.splitlines())) <= 120


@pytest.mark.slow
def test_the_same_seed_gives_the_same_run(again: Again, alone: Path) -> None:
    _, document, said = again(alone, "--seed", "1")
    assert {test["difference"] for test in document["again"]["tests"] if not test["first_bound"]} == {0.0}
    assert "the same: seed 1" in said


@pytest.mark.slow
def test_a_changed_unit_differs_and_the_bench_and_the_verdict_say_so(again: Again, first: Path, tmp_path: Path) -> None:
    changed = "seed = 1\n[physics.gyro]\nK0_v_per_dps = 0.0501\n"
    (tmp_path / "other.toml").write_text(BENCH.replace("seed = 1\n", changed))
    status, document, said = again(first, "--bench", "other.toml", "--out", "second")
    assert status == 1
    assert document["ok"] is False
    assert document["error"] == "fails scale_factor"
    assert document["verdict"] == "FAIL"
    told = document["again"]
    assert (told["first_verdict"], told["verdict"]) == ("PASS", "FAIL")
    (scale,) = (test for test in told["tests"] if test["name"] == "scale_factor")
    assert scale["differs"]
    assert scale["e_n"] > 1.0
    assert (scale["first_verdict"], scale["again_verdict"]) == ("PASS", "FAIL")
    assert "+K0_v_per_dps = 0.0501" in told["differences"]["bench"]
    assert not any("seed" in line and line[0] in "+-" for line in told["differences"]["bench"])
    assert told["first_acceptance"] == []
    assert "\ndiffer: scale_factor\n" in said
    assert "\njudged otherwise: scale_factor is FAIL, was PASS\nFAIL, was PASS: fails scale_factor\n" in said
    assert Path(document["report"]).is_file()
    assert json.loads(Path("second/acceptance.json").read_text(encoding="utf-8"))["limits"]["text"] == LIMITS
    kept = json.loads(Path("second/rerun.json").read_text(encoding="utf-8"))
    assert kept == {"schema": "benchctl-rerun/1", **told}
    assert run_verb(["verify", "second", "--quiet"]) == 0


def test_a_bench_that_is_stopped_is_not_compared(again: Again, alone: Path, tmp_path: Path) -> None:
    (tmp_path / "slow.toml").write_text(BENCH + '[[interlocks]]\nquantity = "rate_dps"\nabove = 30.0\n')
    status, document, _ = again(alone, "--bench", "slow.toml", "--out", "second", "--quiet")
    assert status == 3
    assert document["status"] == "aborted"
    assert "rate_dps" in document["error"]
    assert "again" not in document
    assert not Path("second/rerun.json").exists()


@pytest.mark.slow
def test_limits_of_ones_own_judge_both_and_are_a_difference(again: Again, first: Path, tmp_path: Path) -> None:
    (tmp_path / "wide.toml").write_text(LIMITS.replace("46.98", "47.2"))
    status, document, _ = again(first, "--limits", "wide.toml", "--quiet")
    assert status == 0
    assert document["verdict"] == "PASS"
    (told,) = document["again"]["first_acceptance"]
    assert told.startswith("limits (SHA-256) was ")


@pytest.mark.slow
def test_a_value_that_was_stated_otherwise_is_told(again: Again, first: Path, tmp_path: Path) -> None:
    (tmp_path / "recording.h5").write_bytes((first / "recording.h5").read_bytes())
    stated = json.loads((first / "acceptance.json").read_text(encoding="utf-8"))
    stated["tests"][0]["value"] += 1.0
    (tmp_path / "acceptance.json").write_text(json.dumps(stated))
    _, document, said = again(Path("recording.h5"), "--out", "second")
    (told,) = document["again"]["first_acceptance"]
    assert told.startswith("scale_factor was stated as 47.")
    assert "acceptance   scale_factor was stated as" in said


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("hysteresis",), "--again first.h5: names its procedure itself; leave hysteresis out"),
        (("-p", "rates=3"), "--again first.h5: is run with its own parameters; leave -p rates=3 out"),
        (("--resume", "c"), "--again first.h5: begins a campaign, --resume c goes on with one; leave one of them out"),
        (("--limits", "none.toml"), "limits none.toml: cannot be read"),
        (("--bench", "none.toml"), "none.toml"),
    ],
)
def test_arguments_that_contradict_it_are_refused(
    refused: Refused, alone: Path, arguments: tuple[str, ...], says: str
) -> None:
    assert says in refused("--again", alone, *arguments)


def test_without_it_a_procedure_and_a_bench_are_needed(refused: Refused) -> None:
    for arguments in ((), ("hysteresis",), ("--bench", "simulated")):
        assert refused(*arguments).startswith("run needs a procedure")
    without = ("hysteresis", "--limits", "none.toml", "--bench", "simulated")
    assert refused(*without).startswith("limits none.toml: cannot be read")


def test_a_tampered_recording_is_not_run_again(refused: Refused, alone: Path, tmp_path: Path) -> None:
    with h5py.File(tmp_path / alone, "r+") as file:
        file["steps/0003/gyro_v"][7] += 1e-9
    assert "changed since it was written, and so not run again" in refused("--again", alone)


def test_another_unit_on_the_bench_is_refused(refused: Refused, alone: Path, tmp_path: Path) -> None:
    (tmp_path / "other.toml").write_text(BENCH.replace("SIM-0001", "SIM-0002"))
    line = refused("--again", alone, "--bench", "other.toml")
    assert "is of unit SIM-0001, and simulated bench has unit SIM-0002" in line


def test_an_imported_recording_names_no_procedure(refused: Refused, tmp_path: Path) -> None:
    info = StepInfo(index=1, name="rest", kind="static", t_start=0.0, t_end=1.0, chamber_setpoint_c=20.0)
    channels = {name: np.zeros(100) for name in ("encoder_deg", "gyro_v", "gyro_temp_c")}
    steps = [Step(info, {"time_s": np.arange(100) / 100.0, **channels})]
    unit = Unit(serial="F1", range_dps=100.0)
    meta = Meta(status="imported", unit=unit, bench=BenchFacts(sample_rate_hz=100.0))
    write_recording(tmp_path / "foreign.h5", meta, steps)
    assert "it was imported, and so names no procedure to run again" in refused("--again", "foreign.h5")


def test_what_is_no_recording_is_refused(refused: Refused, tmp_path: Path) -> None:
    assert "none.h5" in refused("--again", "none.h5")
    assert str(tmp_path) in refused("--again", tmp_path)
