"""`benchctl apply`: a copy of a recording with the compensated rate of each sample."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchctl.calibration.axes_compensation import AxesCompensation
from benchctl.calibration.compensating import Compensation
from benchctl.recordings.model import (
    AXIS_CHANNELS,
    AXIS_COMPENSATED,
    COMPENSATED,
    COMPENSATED_VALID,
    FRAME_CHANNELS,
    FRAME_COMPENSATED,
    FRAME_COMPENSATED_VALID,
    Meta,
    Step,
    axis_of,
)
from benchctl.recordings.reader import Recording
from benchctl.recordings.writer import write_recording
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True)
class _Channels:
    """The channels of the outputs, their temperature and status (0: valid; "": none), and those of the result."""

    outputs: tuple[str, ...]
    celsius: str
    status: str
    rates: tuple[str, ...]
    valid: str


_RATE, _CELSIUS, _STATUS = FRAME_CHANNELS[1:]
_OF_SCANS = _Channels(("gyro_v",), "gyro_temp_c", "", (COMPENSATED,), COMPENSATED_VALID)
_OF_FRAMES = _Channels((_RATE,), _CELSIUS, _STATUS, (FRAME_COMPENSATED,), FRAME_COMPENSATED_VALID)
_OF_AXES = _Channels(AXIS_CHANNELS, _CELSIUS, "", AXIS_COMPENSATED, FRAME_COMPENSATED_VALID)


@dataclass(slots=True)
class Applied:
    """The result of the compensation of a recording.

    `samples` have a rate or NaN, of which `outside` have a rate or a temperature outside the measured range, by at most
    `most_dps` and `most_c`; `without` lists the steps that have an output but no temperature.
    """

    samples: int = 0
    outside: int = 0
    most_dps: float = 0.0
    most_c: float = 0.0
    without: tuple[int, ...] = ()


def write_compensated(
    path: Path, recording: Recording, compensation: Compensation | AxesCompensation, *, digest: str, coefficients: str
) -> Applied:
    """Write a copy of the recording with `compensated_dps` and `compensated_valid` in each step that can have them.

    Coefficients of a rate are applied to a digital gyro's frames, if there are any: `frame_compensated_dps`,
    `frame_compensated_valid`. Those of three axes give `frame_compensated_x_dps` and so on, which are valid together.
    Samples that the gyro states as invalid have no rate.

    One step is in memory at a time. The provenance names the recording by its `digest`, and the file of coefficients
    by its name and SHA-256. No sample is moved in time: `comment` of the channel states its delay.

    Raises
    ------
    UsageError
        If the coefficients are of another unit or output, the recording is already compensated, no step has an output
        and a temperature, or the disk cannot be written. No partial file remains.
    """
    channels = {info.index: recording.channels(info.index) for info in recording.infos}
    digital = compensation.output_unit == "deg/s" and any(_RATE in names for names in channels.values())
    _refuse_another(recording, compensation, "deg/s" if digital else recording.meta.output_unit)
    own = _OF_FRAMES if digital else _OF_SCANS
    if isinstance(compensation, AxesCompensation):
        own = _OF_AXES
    if any(own.rates[0] in names for names in channels.values()):
        raise UsageError(
            f"{recording.path}: has {own.rates[0]} already; take the recording that it was made of, which its "
            "provenance names"
        )
    if not any({*own.outputs, own.celsius} <= set(names) for names in channels.values()):
        raise UsageError(
            f"{recording.path}: no step has {own.outputs[0]} and {own.celsius}, sample by sample, and so nothing "
            "to compensate; `benchctl show` lists its channels"
        )
    applied = Applied(
        without=tuple(
            index for index, names in channels.items() if own.outputs[0] in names and own.celsius not in names
        )
    )
    meta = _described(recording, compensation, own, digest, coefficients)
    write_recording(path, meta, _compensated(recording, compensation, own, applied))
    return applied


def _refuse_another(recording: Recording, compensation: Compensation | AxesCompensation, output_unit: str) -> None:
    serial = recording.meta.unit.serial
    if serial and compensation.unit and serial != compensation.unit:
        raise UsageError(
            f"{recording.path}: is of unit {serial}, the coefficients are of unit {compensation.unit}; take those of "
            "its own unit"
        )
    if output_unit != compensation.output_unit:
        raise UsageError(
            f"{recording.path}: its output is in {output_unit}, that of the coefficients in "
            f"{compensation.output_unit}; take those that were fitted on such a recording"
        )


def _described(
    recording: Recording, compensation: Compensation | AxesCompensation, own: _Channels, digest: str, coefficients: str
) -> Meta:
    meta, valid, delay_s = recording.meta, compensation.valid, compensation.delay_s
    facts = {
        "recording": recording.path.name,
        "digest": digest,
        "coefficients": coefficients,
        "coefficients_sha256": compensation.sha256,
        "law": compensation.by,
        "delay_s": delay_s,
    }
    behind = "" if delay_s is None else f"; the rate belongs to {axis_of(own.valid)} - {delay_s:.9g} s"
    comments = {
        **dict.fromkeys(own.rates, f"by coefficients with SHA-256 {compensation.sha256}, {compensation.words}{behind}"),
        own.valid: f"the coefficients were measured from {valid.rate_dps[0]:.9g} to {valid.rate_dps[1]:.9g} "
        f"degree/s and from {valid.temperature_c[0]:.9g} to {valid.temperature_c[1]:.9g} degC",
    }
    return replace(
        meta,
        provenance={**meta.provenance, "compensation": json.dumps(facts, ensure_ascii=False)},
        extra={**meta.extra, "channel_comments": {**meta.extra.get("channel_comments", {}), **comments}},
    )


def _compensated(
    recording: Recording, compensation: Compensation | AxesCompensation, own: _Channels, applied: Applied
) -> Iterator[Step]:
    for step in recording.steps():
        has_both = {*own.outputs, own.celsius} <= set(step.channels)
        yield _with_rate(step, compensation, own, applied) if has_both else step


def _with_rate(step: Step, compensation: Compensation | AxesCompensation, own: _Channels, applied: Applied) -> Step:
    celsius = step[own.celsius]
    rates_dps = compensation.rates_dps(np.array([step[name] for name in own.outputs]), celsius)
    if own.status:
        rates_dps[:, step[own.status] != 0.0] = np.nan
    inside: BoolArray = np.logical_and.reduce(compensation.valid.inside(rates_dps, celsius))
    applied.samples += inside.size
    applied.outside += int(np.count_nonzero(~inside))
    applied.most_dps = max(applied.most_dps, _beyond(rates_dps, compensation.valid.rate_dps))
    applied.most_c = max(applied.most_c, _beyond(celsius, compensation.valid.temperature_c))
    found: dict[str, FloatArray] = dict(zip(own.rates, rates_dps, strict=True))
    return Step(step.info, {**step.channels, **found, own.valid: inside.astype(np.float64)})


def _beyond(values: FloatArray, ends: tuple[float, float]) -> float:
    known = values[np.isfinite(values)]
    return float(max(np.max(known, initial=ends[1]) - ends[1], ends[0] - np.min(known, initial=ends[0]), 0.0))
