"""`run --resume` and `recover` as users meet them: real processes, real wires, a real SIGKILL."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchctl.recordings.reader import open_recording
from tests.benchctl.cli.processes import simulated_servers, started, without_a_process

PROCEDURE = """
from benchctl.plan import ConstantRate, Soak, Static, procedure

@procedure()
def turns(run_s: float = 60.0):
    '''Two rates between zeros.'''
    yield Soak(setpoint_c=23.0, hold_s=10.0, drift_c_per_min=1.0)
    yield Static(duration_s=20.0)
    yield ConstantRate(rate_dps=90.0, duration_s=run_s)
    yield ConstantRate(rate_dps=-90.0, duration_s=run_s)
"""
SPEED = "100"
RESUME = ("run", "turns.py", "--bench", "bench.toml", "--resume", "c")

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")


def _run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "benchctl", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=150, stdin=subprocess.DEVNULL)


def _kill_when(folder: Path, seen: str, *arguments: str) -> str:
    """Run a verb, and kill it once a file of that pattern is there; what it had said on stderr."""
    with subprocess.Popen(
        [sys.executable, "-m", "benchctl", *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process:
        deadline_s = time.monotonic() + 150
        while not list(folder.glob(seen)):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline_s, f"{seen} never came"
            time.sleep(0.02)
        process.kill()
        process.wait()
        return ""


@pytest.fixture(scope="module")
def crashed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a campaign that was killed in its third step, and the bench that it ran on, still there."""
    folder = tmp_path_factory.mktemp("resume")
    (folder / "turns.py").write_text(PROCEDURE)
    with simulated_servers(folder / "bench.toml", "--speed", SPEED):
        _kill_when(folder, "c/steps/0003*.part", "run", "turns.py", "--bench", "bench.toml", "--out", "c")
        yield folder


def test_a_campaign_whose_program_was_killed_is_said_to_be_aborted(crashed: Path) -> None:
    shown = without_a_process("show", "c", folder=crashed)
    assert shown.stdout.startswith("c: aborted, unit SIM-0001")
    assert "its program died" in shown.stdout
    assert "--bench BENCH --resume c goes on with it" in shown.stdout


def test_without_a_terminal_nothing_moves_unless_yes_is_said(crashed: Path) -> None:
    refused = _run(crashed, *RESUME)
    assert refused.returncode == 2
    assert "2 of 4 steps are complete; step 3, rate +90, is next on simulated bench" in refused.stderr
    assert "pass --yes" in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1


def test_another_parameter_is_refused_and_named(crashed: Path) -> None:
    refused = without_a_process(*RESUME, "--yes", "-p", "run_s=20", folder=crashed)
    assert refused.returncode == 2
    assert refused.stderr == (
        "benchctl: --resume: this is not the campaign that was begun: parameter run_s was 60.0, is 20.0; "
        "give it back what it began with, or run anew\n"
    )


def test_a_folder_of_its_own_and_a_campaign_to_go_on_with_exclude_each_other(crashed: Path) -> None:
    refused = without_a_process(*RESUME, "--out", "d", folder=crashed)
    assert refused.returncode == 2
    assert "--out d: a campaign that is resumed stays in its folder, c" in refused.stderr


def test_at_a_terminal_somebody_is_asked_and_a_no_leaves_all_as_it_was(crashed: Path) -> None:
    import pty

    before = sorted((file, file.stat().st_mtime_ns) for file in crashed.glob("c/steps/*"))
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "benchctl", *RESUME], cwd=crashed, stdin=theirs, stdout=theirs, stderr=theirs
    ) as process:
        os.close(theirs)
        asked = b""
        while b"[y/N]" not in asked:
            asked += os.read(ours, 4096)
        os.write(ours, b"n\n")
        assert process.wait(timeout=150) == 2
    os.close(ours)
    assert b"The chamber will be soaked and the table will move. Is everybody clear of it?" in asked
    assert sorted((file, file.stat().st_mtime_ns) for file in crashed.glob("c/steps/*")) == before


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_killed_again_and_resumed_it_ends_complete_and_a_complete_one_is_left_alone(crashed: Path) -> None:
    _kill_when(crashed, "c/steps/0003_rate_+90_at_+23.h5", *RESUME, "--yes")
    ended = _run(crashed, *RESUME, "--yes", "--json", "r.json")
    assert ended.returncode == 0, ended.stderr
    told = json.loads((crashed / "r.json").read_text())
    assert (told["ok"], told["status"], told["steps"]) == (True, "complete", {"planned": 4, "whole": 4})
    assert told["campaign"] == "c"
    assert _run(crashed, "verify", "c").stdout.startswith("c: nothing changed since it was written; campaign digest ")
    with open_recording(crashed / "c") as recording:
        assert recording.meta.status == "complete"
        assert [info.whole for info in recording.infos[:4]] == [True] * 4
        assert told["samples"] == sum(info.samples for info in recording.infos)
        begun = recording.meta.provenance["started_utc"]
    before = (crashed / "c" / "recording.h5").read_bytes()
    again = _run(crashed, *RESUME, "--json", "again.json")
    assert again.returncode == 0, again.stderr
    assert "complete: 4 of 4 steps complete" in again.stdout
    told_again = json.loads((crashed / "again.json").read_text())
    assert {key: told_again[key] for key in ("status", "steps", "samples", "recording")} == {
        key: told[key] for key in ("status", "steps", "samples", "recording")
    }
    assert set(told_again) == set(told)
    assert (crashed / "c" / "recording.h5").read_bytes() == before
    assert begun


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_a_bench_that_is_in_use_is_refused_to_a_second_run_and_to_a_check_and_a_campaign_to_whoever_would_close_it(
    tmp_path: Path,
) -> None:
    (tmp_path / "turns.py").write_text(PROCEDURE)
    with (
        simulated_servers(tmp_path / "bench.toml", "--speed", "2") as _,
        started("run", tmp_path / "turns.py", "--bench", tmp_path / "bench.toml", "--out", tmp_path / "c") as process,
    ):
        deadline_s = time.monotonic() + 150
        while not (tmp_path / "c" / "campaign.h5").exists():
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        second = _run(tmp_path, "run", "turns.py", "--bench", "bench.toml", "--out", "d")
        checked = _run(tmp_path, "check", "turns.py", "--bench", "bench.toml")
        closed = _run(tmp_path, "recover", "c")
        resumed = _run(tmp_path, "run", "turns.py", "--bench", "bench.toml", "--resume", "c", "--yes")
        shown = _run(tmp_path, "show", "c")
        assert process.poll() is None
        process.terminate()
        process.wait(timeout=20)
    for refused in (second, checked):
        assert refused.returncode == 3
        assert f"is in use by process {process.pid} (campaign {tmp_path / 'c'}, since " in refused.stderr
    assert not (tmp_path / "d").exists()
    for refused in (closed, resumed):
        assert refused.returncode == 2
        assert f"campaign c is in use by process {process.pid} (recording, since " in refused.stderr
    assert shown.stdout.startswith("c: running")


def test_recover_closes_the_recording_of_a_killed_program_says_what_is_whole_and_may_be_called_again(
    tmp_path: Path,
) -> None:
    (tmp_path / "turns.py").write_text(PROCEDURE.replace("run_s: float = 60.0", "run_s: float = 50000.0"))
    _kill_when(tmp_path, "c/steps/0003*.part", "run", "turns.py", "--bench", "simulated", "--out", "c")
    closed = _run(tmp_path, "recover", "c", "--json", "r.json")
    assert closed.returncode == 0, closed.stderr
    told = json.loads((tmp_path / "r.json").read_text())
    assert (told["schema"], told["ok"], told["status"]) == ("benchctl-recover/1", True, "aborted")
    assert told["steps"]["whole"] == 2
    assert told["reason"].startswith("its program died, last heard of at 2")
    assert "2 steps are complete" in closed.stdout
    again = without_a_process("recover", "c", folder=tmp_path)
    assert again.returncode == 0
    assert "was closed before, nothing to do; aborted (its program died" in again.stdout
    assert without_a_process("verify", "c", folder=tmp_path).returncode == 0


def test_a_folder_without_a_campaign_is_refused(tmp_path: Path) -> None:
    refused = without_a_process("recover", tmp_path)
    assert (refused.returncode, "is no campaign" in refused.stderr) == (2, True)
