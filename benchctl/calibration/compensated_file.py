"""Copy a recording and add the compensated rate."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchctl.calibration.compensating import Compensation
from benchctl.recordings.model import COMPENSATED, COMPENSATED_VALID, Meta, Step
from benchctl.recordings.reader import Recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError

_NEEDED = ("gyro_v", "gyro_temp_c")


@dataclass(slots=True)
class Applied:
    """What became of a recording's samples.

    `samples` got a rate or NaN, of which `outside` have a rate or a temperature that the coefficients were not measured
    at, by `most_dps` and `most_c` at most; `without` lists the steps that have an output and no temperature.
    """

    samples: int = 0
    outside: int = 0
    most_dps: float = 0.0
    most_c: float = 0.0
    without: tuple[int, ...] = ()


def write_compensated(
    path: Path, recording: Recording, compensation: Compensation, *, digest: str, coefficients: str
) -> Applied:
    """Write the recording anew with `compensated_dps` and `compensated_valid` in each step that can have them.

    One step is in memory at a time. The provenance names the recording by its `digest`, and the file of coefficients
    by its name and SHA-256. No sample is moved in time: `comment` of the channel states its delay.

    Raises
    ------
    UsageError
        The coefficients are of another unit or output, the recording is compensated already, no step has an output and
        a temperature, or the disk refuses. Nothing is left behind.
    """
    _refuse_another(recording, compensation)
    channels = {info.index: recording.channels(info.index) for info in recording.infos}
    if any(COMPENSATED in names for names in channels.values()):
        raise UsageError(
            f"{recording.path}: has {COMPENSATED} already; take the recording that it was made of, which its "
            "provenance names"
        )
    if not any(set(_NEEDED) <= set(names) for names in channels.values()):
        raise UsageError(
            f"{recording.path}: no step has gyro_v and gyro_temp_c, sample by sample, and so nothing "
            "to compensate; `benchctl show` lists its channels"
        )
    applied = Applied(
        without=tuple(index for index, names in channels.items() if "gyro_v" in names and "gyro_temp_c" not in names)
    )
    meta = _described(recording, compensation, digest, coefficients)
    write_recording(path, meta, _compensated(recording, compensation, applied))
    return applied


def _refuse_another(recording: Recording, compensation: Compensation) -> None:
    serial = recording.meta.unit.serial
    if serial and compensation.unit and serial != compensation.unit:
        raise UsageError(
            f"{recording.path}: is of unit {serial}, the coefficients are of unit {compensation.unit}; take those of "
            "its own unit"
        )
    if recording.meta.output_unit != compensation.output_unit:
        raise UsageError(
            f"{recording.path}: its output is in {recording.meta.output_unit}, that of the coefficients in "
            f"{compensation.output_unit}; take those that were fitted on such a recording"
        )


def _described(recording: Recording, compensation: Compensation, digest: str, coefficients: str) -> Meta:
    meta, law, valid = recording.meta, compensation.law, compensation.valid
    facts = {
        "recording": recording.path.name,
        "digest": digest,
        "coefficients": coefficients,
        "coefficients_sha256": compensation.sha256,
        "law": compensation.by,
        "delay_s": law.delay_s,
    }
    comments = {
        COMPENSATED: f"by coefficients with SHA-256 {compensation.sha256}, law {law.name} of the "
        f"{'joint fit' if compensation.by == 'joint' else 'stages'}; the rate belongs to time_s - {law.delay_s:.9g} s",
        COMPENSATED_VALID: f"the coefficients were measured from {valid.rate_dps[0]:.9g} to {valid.rate_dps[1]:.9g} "
        f"degree/s and from {valid.temperature_c[0]:.9g} to {valid.temperature_c[1]:.9g} degC",
    }
    return replace(
        meta,
        provenance={**meta.provenance, "compensation": json.dumps(facts, ensure_ascii=False)},
        extra={**meta.extra, "channel_comments": {**meta.extra.get("channel_comments", {}), **comments}},
    )


def _compensated(recording: Recording, compensation: Compensation, applied: Applied) -> Iterator[Step]:
    for step in recording.steps():
        yield _with_rate(step, compensation, applied) if set(_NEEDED) <= set(step.channels) else step


def _with_rate(step: Step, compensation: Compensation, applied: Applied) -> Step:
    celsius = step["gyro_temp_c"]
    rate_dps = compensation.law.rate_dps(step["gyro_v"], celsius)
    inside = compensation.inside(rate_dps, celsius)
    applied.samples += inside.size
    applied.outside += int(np.count_nonzero(~inside))
    applied.most_dps = max(applied.most_dps, _beyond(rate_dps, compensation.valid.rate_dps))
    applied.most_c = max(applied.most_c, _beyond(celsius, compensation.valid.temperature_c))
    return Step(step.info, {**step.channels, COMPENSATED: rate_dps, COMPENSATED_VALID: inside.astype(np.float64)})


def _beyond(values: np.ndarray, ends: tuple[float, float]) -> float:
    known = values[np.isfinite(values)]
    return float(max(np.max(known, initial=ends[1]) - ends[1], ends[0] - np.min(known, initial=ends[0]), 0.0))
