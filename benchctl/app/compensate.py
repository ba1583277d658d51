"""Compensate a recording with coefficients, and find the coefficients that belong to a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.atomic import refuse_existing, refuse_folder
from benchctl.calibration.axes_compensation import AxesCompensation
from benchctl.calibration.coefficients import By
from benchctl.calibration.compensated_file import Applied, write_compensated
from benchctl.calibration.compensating import Compensation, read_compensation
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.import_open import OPEN_DESCRIPTION
from benchctl.recordings.reader import open_recording
from benchctl.recordings.schema import CAMPAIGN, RECORDING
from benchctl.recordings.verify import refuse_changed
from benchctl.reports.results import source_digest
from benchctl_instruments.errors import UsageError

COEFFICIENTS = "coefficients.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensated:
    """A compensated copy of a recording; `print` shows the text of `benchctl apply`.

    `recording` is the copy, `applied` counts its samples and those outside the range of the `coefficients`.
    """

    recording: Path
    coefficients: Path
    compensation: Compensation | AxesCompensation
    applied: Applied

    def values(self) -> dict[str, Any]:
        """Return the data for `--json`."""
        return {
            "recording": self.recording,
            "coefficients": self.coefficients,
            "law": self.compensation.by,
            "samples": self.applied.samples,
            "outside": self.applied.outside,
            "outside_most": {"rate_dps": self.applied.most_dps, "temperature_c": self.applied.most_c},
            "steps_without_temperature": list(self.applied.without),
            "delay_s": self.compensation.delay_s,
        }

    def __str__(self) -> str:
        delay_s, applied = self.compensation.delay_s, self.applied
        behind = "" if delay_s is None else f"; a rate belongs to its stamp less {1e3 * delay_s:.4g} ms"
        lines = [f"{self.recording}: {applied.samples:,} samples compensated, {self.compensation.words}{behind}"]
        if applied.outside:
            lines.append(
                f"note: {applied.outside:,} samples lie where the coefficients were not measured, by up to "
                f"{applied.most_dps:.3g} deg/s and {applied.most_c:.3g} degC: 0 in compensated_valid"
            )
        if applied.without:
            lines.append(
                f"note: {len(applied.without)} steps have no gyro_temp_c and got no rate: "
                f"{', '.join(map(str, applied.without[:20]))}{', …' if len(applied.without) > 20 else ''}"
            )
        return "\n".join(lines)


def compensate(path: Path, coefficients: Path, output: Path, *, law: By | None = None) -> Compensated:
    """Write a copy of a recording with the compensated rate in an additional channel.

    The channel is `compensated_dps`; of a digital gyro's frames, `frame_compensated_dps`; of a unit of three axes,
    `frame_compensated_x_dps`, `frame_compensated_y_dps` and `frame_compensated_z_dps`.

    `law` chooses that of the `coefficients`, by default the joint fit's, if there is one.

    Raises
    ------
    UsageError
        If `output` exists, the coefficients are unusable or of another unit, the recording was changed, cannot be read
        or compensated, or nothing can be written.
    """
    refuse_existing(output)
    refuse_folder(output)
    compensation = read_compensation(coefficients, law)
    refuse_changed(path, "compensated")
    with open_recording(path) as recording:
        digest = source_digest(recording)
        if not digest:
            raise UsageError(f"{path}: has no digest yet; let it end, or close it with benchctl recover")
        applied = write_compensated(output, recording, compensation, digest=digest, coefficients=coefficients.name)
    add_to_manifest(output.parent, [output])
    return Compensated(recording=output, coefficients=coefficients, compensation=compensation, applied=applied)


def own_compensation(source: Path) -> Compensation | AxesCompensation:
    """Return the compensation in a coefficients file, or the one in a recording's folder.

    Raises
    ------
    UsageError
        If the coefficients are missing or unusable, or if they were not fitted on this recording: the same folder may
        contain the results of another one.
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
    """Return the recording's digest; None for a folder of results that holds no recording."""
    if source.is_dir() and not any((source / name).exists() for name in (RECORDING, CAMPAIGN, OPEN_DESCRIPTION)):
        return None
    with open_recording(source) as recording:
        return source_digest(recording)
