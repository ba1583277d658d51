"""What lies at a path that `benchctl.recordings.reader.open_recording` takes."""

from __future__ import annotations

from pathlib import Path

from benchctl.recordings.reader import OPEN_DESCRIPTION
from benchctl.recordings.schema import CAMPAIGN, RECORDING


def recording_in(path: Path) -> Path | None:
    """The one file of ours that holds a whole recording: the path itself or a file in it; None where there is none."""
    if not path.is_dir():
        return path
    return path / RECORDING if (path / RECORDING).exists() else None


def is_open_recording(path: Path) -> bool:
    """Whether a folder holds an open recording and nothing of ours."""
    return (path / OPEN_DESCRIPTION).exists() and not any((path / name).exists() for name in (RECORDING, CAMPAIGN))
