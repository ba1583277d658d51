"""A file system that refuses a write although the disk has room, as a quota does: here a limit on the size of files."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.recordings.reader import open_recording
from benchctl.recordings.recover import recover
from benchctl.recordings.verify import verify
from tests.benchctl.cli.test_full_disk import PROCEDURE

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of files")

MANY_STEPS = """
from benchctl.plan import Static, procedure

@procedure()
def turns():
    '''Rest, again and again.'''
    for _ in range(40):
        yield Static(duration_s=30.0)
"""


def _run_with_files_of_at_most(kibibytes: int, folder: Path, procedure: str, *options: str) -> dict[str, object]:
    """What `run --json` says of a run whose files may not grow further; it ended in one line, with status 3."""
    (folder / "turns.py").write_text(procedure)
    run = [sys.executable, "-m", "benchctl", "run", "turns.py", "--bench", "simulated", *options]
    limited = [
        "bash",
        "-c",
        f'ulimit -c 0 -f {kibibytes}; exec "$@"',
        "run",
        *run,
        "--out",
        "c",
        "--json",
        "r.json",
        "-q",
    ]
    ran = subprocess.run(limited, cwd=folder, capture_output=True, text=True, timeout=150)
    assert ran.returncode == 3, ran.stderr
    [line] = ran.stderr.splitlines()
    assert line.count("cannot be written: file too large") == 1
    result: dict[str, object] = json.loads((folder / "r.json").read_text())
    assert result["error"] == line.removeprefix("benchctl: ")
    return result


@pytest.mark.parametrize(
    "kibibytes", [1500, *(pytest.param(more, marks=pytest.mark.slow) for more in (*range(1300, 21000, 1461), 5000))]
)
def test_a_step_that_the_file_system_does_not_take_ends_the_run_and_leaves_the_finished_steps(
    tmp_path: Path, kibibytes: int
) -> None:
    result = _run_with_files_of_at_most(kibibytes, tmp_path, PROCEDURE, "-p", "run_s=2000")
    assert (result["status"], result["steps"]) == ("aborted", {"planned": 3, "whole": 1})
    closed = recover(tmp_path / "c")  # without the limit
    assert [info.whole for info in closed.steps] == [True, False]
    assert closed.unreadable == ()
    assert verify(tmp_path / "c") == []


def test_a_recording_that_the_file_system_does_not_take_leaves_all_steps_to_be_gathered_later(tmp_path: Path) -> None:
    result = _run_with_files_of_at_most(2000, tmp_path, MANY_STEPS)
    assert (result["status"], result["steps"]) == ("aborted", {"planned": 40, "whole": 40})
    with open_recording(tmp_path / "c") as recording:
        assert len(recording.infos) == 40
    closed = recover(tmp_path / "c")
    assert (closed.status, closed.complete) == ("complete", 40)
    assert verify(tmp_path / "c") == []
