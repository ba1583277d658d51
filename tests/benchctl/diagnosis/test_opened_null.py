"""A foreign recording in which nothing is missing, and whose table's ripple the servo shifts in time."""

from pathlib import Path

import pytest

from benchctl.diagnosis import diagnose
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import open_recording
from tests.shared import SHARED, needs_shared


@pytest.mark.slow
@needs_shared("recordings/opened/null")
def test_ripple_that_the_servo_shifts_is_no_unknown_structure(tmp_path: Path) -> None:
    recording = tmp_path / "null.h5"
    import_recording(SHARED / "recordings" / "opened" / "null", None, recording)
    with open_recording(recording) as opened:
        said = diagnose(opened)
    assert said.verdict == "consistent"
