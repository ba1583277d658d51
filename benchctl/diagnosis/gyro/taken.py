"""The steps of a recording that a diagnosis looks at: all of them, or pieces of them where memory would not hold all.

The pieces are drawn by lot, always the same ones, from all steps alike. What the thermometer said in the rest is kept
as means: a gyro remembers its temperatures for minutes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.signals.temperature import Readings
from benchctl.limits import memory_bytes
from benchctl.recordings.model import Step, StepInfo
from benchctl.recordings.reader import Recording
from benchctl.recordings.stored import StoredStep

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

NEEDED = ("time_s", "encoder_deg", "gyro_v")
THERMISTOR, AIR, FILLED = "gyro_temp_c", "chamber_temp_c", "filled"

PIECE = 8192
"""Rows of a piece: many times what a filter loses at its ends."""

_MOST_ROWS = 10_000_000
_BYTES_A_ROW = 1050
"""What a diagnosis of so many rows holds at its peak, measured."""
_SHARE = 0.6
_MILLION = 1_000_000
_MEANS_A_SECOND = 8.0
_NOTHING = Readings(np.empty(0), np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """Steps with scans of motion and output, and the thermometer (a channel, "" for none) that they have.

    `unseen` is what that thermometer said in the `left_out` rows, as means of an eighth of a second.
    """

    steps: Sequence[Step]
    thermometer: str
    unseen: Sequence[Readings] = ()
    left_out: int = 0


def most_rows() -> int:
    """How many rows a diagnosis looks at on this machine: whole millions, so that machines alike say alike."""
    there = memory_bytes()
    if there is None:
        return _MOST_ROWS
    return min(_MOST_ROWS, max(int(_SHARE * there / _BYTES_A_ROW) // _MILLION, 1) * _MILLION)


def taken_of(recording: Recording, most: int | None = None) -> Taken:
    """All rows of the steps that have scans of encoder and gyro, or, where they have more, `most` of these rows."""
    if most is None or sum(info.samples for info in recording.infos if not info.is_left_out) <= most:
        steps = [step for step in recording.steps() if _has_scans(step.info, step.channels) and len(step["time_s"]) > 1]
        return Taken(steps=steps, thermometer=_thermometer([step.channels for step in steps]))
    stored = [step for step in recording.stored_steps() if _has_scans(step.info, step.names) and step.scans > 1]
    thermometer = _thermometer([step.names for step in stored])
    steps, unseen, left_out = [], [], 0
    for step, rows in zip(stored, _drawn([step.scans for step in stored], most), strict=True):
        seen, rest = _parted(step, rows, thermometer)
        unseen.append(rest)
        left_out += int(np.count_nonzero(~rows))
        if rows.any():
            polls = recording.step(step.info.index, [name for name in step.names if name.startswith("poll_")])
            steps.append(Step(step.info, {**seen, **polls.channels}))
    return Taken(steps=steps, thermometer=thermometer, unseen=unseen, left_out=left_out)


def _has_scans(info: StepInfo, channels: Collection[str]) -> bool:
    return not info.is_left_out and all(name in channels for name in NEEDED)


def _thermometer(steps: Sequence[Collection[str]]) -> str:
    return next((one for one in (THERMISTOR, AIR) if all(one in channels for channels in steps)), "")


def _drawn(scans: Sequence[int], most: int) -> list[BoolArray]:
    """Which rows of each step are looked at, shape (scans,) each."""
    pieces = [(step, first) for step, rows in enumerate(scans) for first in range(0, rows, PIECE)]
    rows = np.array([min(PIECE, scans[step] - first) for step, first in pieces])
    lot = np.random.default_rng(0).permutation(len(pieces))
    drawn = [np.zeros(count, np.bool_) for count in scans]
    for place in lot[np.cumsum(rows[lot]) <= most].tolist():
        step, first = pieces[place]
        drawn[step][first : first + PIECE] = True
    return drawn


def _parted(step: StoredStep, rows: BoolArray, thermometer: str) -> tuple[dict[str, FloatArray], Readings]:
    """The channels of some rows of a step, and what the thermometer said in the others."""
    begin, seen, unseen = 0, list[Mapping[str, FloatArray]](), list[Readings]()
    for part in step.parts(None if rows.any() else {"time_s", thermometer} & set(step.names)):
        own = rows[begin : begin + part["time_s"].size]
        begin += own.size
        seen.append({name: samples[own] for name, samples in part.channels.items()})
        unseen.append(_means(part["time_s"][~own], part[thermometer][~own]) if thermometer else _NOTHING)
    whole = {name: np.concatenate([one[name] for one in seen]) for name in seen[0]}
    return whole, Readings(*map(np.concatenate, zip(*unseen, strict=True)))


def _means(time_s: FloatArray, temp_c: FloatArray) -> Readings:
    known = np.isfinite(time_s) & np.isfinite(temp_c)
    time_s, temp_c = time_s[known], temp_c[known]
    if not time_s.size:
        return _NOTHING
    firsts = np.concatenate([[0], np.flatnonzero(np.diff(np.floor(_MEANS_A_SECOND * time_s))) + 1])
    samples = np.diff([*firsts, time_s.size]).astype(np.float64)
    return Readings(np.add.reduceat(time_s, firsts) / samples, np.add.reduceat(temp_c, firsts) / samples, samples)
