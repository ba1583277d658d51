"""The steps of a recording that a diagnosis uses: all of them, or pieces if all would exceed the memory.

The pieces are a reproducible random sample from all steps. The thermometer readings of the other rows are kept as
means, because a gyro remembers its temperatures for minutes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.limits import memory_bytes
from benchctl.recordings.model import Step, StepInfo, axis_of
from benchctl.recordings.reader import Recording
from benchctl.recordings.stored import StoredStep
from benchctl.signals.temperature import Readings
from benchctl_instruments.arrays import BoolArray, FloatArray

NEEDED = ("time_s", "encoder_deg", "gyro_v")
THERMISTOR, AIR, FILLED = "gyro_temp_c", "chamber_temp_c", "filled"

PIECE = 8192
"""Rows of a piece: many times the rows that a filter loses at its ends."""

_MOST_ROWS = 10_000_000
_BYTES_A_ROW = 1050
"""Measured peak memory of a diagnosis [bytes per row]."""
_SHARE = 0.6
_MILLION = 1_000_000
_MEANS_A_SECOND = 8.0
_NOTHING = Readings(np.empty(0), np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Subsample:
    """Steps with scans of motion and output, and their common thermometer (a channel, "" for none).

    `unseen` are the thermometer readings in the `left_out` rows, as means over an eighth of a second.
    """

    steps: Sequence[Step]
    thermometer: str
    unseen: Sequence[Readings] = ()
    left_out: int = 0


def most_rows() -> int:
    """Return how many rows a diagnosis uses on this machine, in millions, so that similar machines agree."""
    available = memory_bytes()
    if available is None:
        return _MOST_ROWS
    return min(_MOST_ROWS, max(int(_SHARE * available / _BYTES_A_ROW) // _MILLION, 1) * _MILLION)


def subsample_of(recording: Recording, most: int | None = None) -> Subsample:
    """Return all rows of the steps with scans of encoder and gyro, or a sample of at most `most` rows."""
    if most is None or sum(info.samples for info in recording.infos if not info.is_left_out) <= most:
        steps = [step for step in recording.steps() if _has_scans(step.info, step.channels) and len(step["time_s"]) > 1]
        return Subsample(steps=steps, thermometer=_thermometer([step.channels for step in steps]))
    steps, readings, left_out = [], list[Mapping[str, Readings]](), 0
    for info, firsts in _drawn([info for info in recording.infos if not info.is_left_out], most):
        step = recording.stored_step(info.index)
        if not _has_scans(info, step.names) or step.scans < 2:
            continue
        rows = np.zeros(step.scans, np.bool_)
        for first in firsts:
            rows[first : first + PIECE] = True
        selected, unseen = _parted(step, rows)
        readings.append(unseen)
        left_out += int(np.count_nonzero(~rows))
        if rows.any():
            polls = recording.step(info.index, [name for name in step.names if axis_of(name) == "poll_time_s"])
            steps.append(Step(info, {**selected, **polls.channels}))
    thermometer = _thermometer(readings)
    unseen_by_it = [one[thermometer] for one in readings] if thermometer else []
    return Subsample(steps=steps, thermometer=thermometer, unseen=unseen_by_it, left_out=left_out)


def _has_scans(info: StepInfo, channels: Collection[str]) -> bool:
    return not info.is_left_out and all(name in channels for name in NEEDED)


def _thermometer(steps: Sequence[Collection[str]]) -> str:
    return next((one for one in (THERMISTOR, AIR) if all(one in channels for channels in steps)), "")


def _drawn(infos: Sequence[StepInfo], most: int) -> Iterator[tuple[StepInfo, list[int]]]:
    """Yield each step with the first rows of its sampled pieces, in order."""
    pieces = [(step, first) for step, info in enumerate(infos) for first in range(0, info.samples, PIECE)]
    rows = np.array([min(PIECE, infos[step].samples - first) for step, first in pieces])
    lot = np.random.default_rng(0).permutation(len(pieces))
    drawn: list[list[int]] = [[] for _ in infos]
    for place in np.sort(lot[np.cumsum(rows[lot]) <= most]).tolist():
        step, first = pieces[place]
        drawn[step].append(first)
    return zip(infos, drawn, strict=True)


def _parted(step: StoredStep, rows: BoolArray) -> tuple[dict[str, FloatArray], dict[str, Readings]]:
    """Return the channels of some rows of a step, and the readings of its thermometers in the others."""
    thermometers = [name for name in (THERMISTOR, AIR) if name in step.names]
    begin, selected, unseen = 0, list[Mapping[str, FloatArray]](), list[list[Readings]]()
    for part in step.parts(None if rows.any() else ("time_s", *thermometers)):
        own = rows[begin : begin + part["time_s"].size]
        begin += own.size
        selected.append({name: samples[own] for name, samples in part.channels.items()})
        unseen.append([_means(part["time_s"][~own], part[name][~own]) for name in thermometers])
    channels = {name: np.concatenate([one[name] for one in selected]) for name in selected[0]}
    by_name = zip(thermometers, zip(*unseen, strict=True), strict=True)
    return channels, {name: Readings(*map(np.concatenate, zip(*those, strict=True))) for name, those in by_name}


def _means(time_s: FloatArray, temp_c: FloatArray) -> Readings:
    known = np.isfinite(time_s) & np.isfinite(temp_c)
    time_s, temp_c = time_s[known], temp_c[known]
    if not time_s.size:
        return _NOTHING
    firsts = np.concatenate([[0], np.flatnonzero(np.diff(np.floor(_MEANS_A_SECOND * time_s))) + 1])
    samples = np.diff([*firsts, time_s.size]).astype(np.float64)
    return Readings(np.add.reduceat(time_s, firsts) / samples, np.add.reduceat(temp_c, firsts) / samples, samples)
