"""Whoever watched a run has gone: the run, its result and its exit status are the same."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.recordings.reader import open_recording

PROCEDURE = """
from benchctl.plan import ConstantRate, procedure

@procedure()
def turn():
    '''Turn for a while.'''
    yield ConstantRate(rate_dps=60.0, duration_s=1000.0)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a pty is a thing of POSIX")
@pytest.mark.parametrize("terminal", [True, False], ids=["a closed window", "a pipe without a reader"])
@pytest.mark.slow
def test_a_run_that_nobody_watches_any_more_goes_on_to_its_end(tmp_path: Path, terminal: bool) -> None:
    import pty

    (tmp_path / "turn.py").write_text(PROCEDURE)
    ours, theirs = pty.openpty() if terminal else os.pipe()
    command = [sys.executable, "-m", "benchctl", "run", "turn.py", "--bench", "simulated"]
    with subprocess.Popen(
        [*command, "--out", "c", "--json", "r.json"], stdout=theirs, stderr=theirs, cwd=tmp_path, start_new_session=True
    ) as process:
        os.close(theirs)
        if terminal:
            assert os.read(ours, 1)  # the bars are drawn
        os.close(ours)
        assert process.wait(timeout=40) == 0
    assert json.loads((tmp_path / "r.json").read_text())["ok"] is True
    with open_recording(tmp_path / "c") as recording:
        assert (recording.meta.status, recording.meta.provenance["reason"]) == ("complete", "")
