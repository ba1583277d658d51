"""Finds the `coefficients.json` that was fitted on a recording, or on a campaign, and reads it for use."""

from __future__ import annotations

from pathlib import Path

from benchctl.calibration.compensating import Compensation, read_compensation
from benchctl.recordings.reader import OPEN_DESCRIPTION, open_recording
from benchctl.recordings.schema import CAMPAIGN, RECORDING
from benchctl.reports.results import source_digest
from benchctl_instruments.errors import UsageError

COEFFICIENTS = "coefficients.json"


def own_compensation(source: Path) -> Compensation:
    """The compensation by a file of coefficients itself, or by that in a recording's folder.

    Raises
    ------
    UsageError
        There are no coefficients, they cannot be used, or they were not fitted on this recording: another one in the
        same folder may have been.
    """
    if source.suffix.lower() == ".json":
        return read_compensation(source)
    folder = source if source.is_dir() else source.parent
    digest = _digest(source)
    path = folder / COEFFICIENTS
    if not path.is_file():
        raise UsageError(f"{source}: there is no {COEFFICIENTS} in {folder}; benchctl fit {source} writes it")
    compensation = read_compensation(path)
    fitted_on = {known for _, known in compensation.sources}
    if digest is not None and digest not in fitted_on:
        raise UsageError(
            f"{path}: was not fitted on {source} as it is now; benchctl fit {source} writes it anew, or name the file "
            "of coefficients itself"
        )
    return compensation


def _digest(source: Path) -> str | None:
    """The recording's digest; None of a folder of results, which holds no recording."""
    if source.is_dir() and not any((source / name).exists() for name in (RECORDING, CAMPAIGN, OPEN_DESCRIPTION)):
        return None
    with open_recording(source) as recording:
        return source_digest(recording)
