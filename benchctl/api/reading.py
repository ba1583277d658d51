"""What the API takes for a recording, and opening one."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from benchctl.campaign.runner import Outcome
from benchctl.recordings.reader import Recording, open_recording
from benchctl.recordings.verify import refuse_changed
from benchctl_instruments.errors import UsageError

Source = Recording | Outcome | str | PathLike[str]
"""A recording: what `api.open` or `api.run` gave, or a path: a file, a campaign's folder or an open recording's."""


def open(path: str | PathLike[str]) -> Recording:
    """Open a recording for reading: a file, a campaign's folder (running, dead or finished) or an open recording's.

    Its `infos` are the steps; `step(index)` loads one, and `[name]` of that is a channel: `time_s` in s, `encoder_deg`,
    `gyro_v`, `gyro_temp_c`. `with` closes it.

    Raises
    ------
    UsageError
        Where there is none, or it cannot be read.

    Examples
    --------
    >>> from benchctl import api
    >>> with api.open("sweep") as recording:
    ...     turning = recording.step(3)
    >>> turning.info.kind, turning["gyro_v"].shape == turning["time_s"].shape
    ('constant_rate', True)
    """
    return open_recording(Path(path))


def paths_of(recordings: Source | Iterable[Source], therefore: str) -> list[Path]:
    """The paths of one recording or of several; raises `UsageError` where there is none, and so nothing `therefore`."""
    given = [recordings] if isinstance(recordings, Recording | Outcome | str | PathLike) else list(recordings)
    if not given:
        raise UsageError(f"nothing was {therefore}: expected a recording, or several of one unit, got none")
    return [_path_of(one) for one in given]


def unchanged_paths_of(recordings: Source | Iterable[Source], therefore: str) -> list[Path]:
    """As `paths_of`, none of them changed since it was written: `UsageError` says which is not `therefore`."""
    paths = paths_of(recordings, therefore)
    for path in paths:
        refuse_changed(path, therefore)
    return paths


def _path_of(recording: Source) -> Path:
    if isinstance(recording, Recording):
        return recording.path
    return recording.recording if isinstance(recording, Outcome) else Path(recording)
