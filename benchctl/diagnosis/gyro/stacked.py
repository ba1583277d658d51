"""Concatenated signals of all stretches of a recording, including the pauses between them.

Pointwise effects are applied to all rows at once; effects with a memory and filters are applied to each part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchctl.diagnosis.gyro.frame import Frame
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.structures import lagged_in_parts

PAUSE = -1
"""The `first_index` of a pause."""

_ARRAYS = (
    "time_s",
    "angle_deg",
    "rate_dps",
    "acceleration_dps2",
    "housing_c",
    "coil_c",
    "sensed_rate_dps",
    "output_v",
    "encoder_deg",
    "thermistor_c",
    "coil_rate_c_per_s",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A stretch, or the pause before it: rows in the stack, first index in the frame, start of its recording."""

    rows: slice
    interval_s: float
    first_index: int
    origin_s: float
    stretch: int

    @property
    def is_pause(self) -> bool:
        """Whether this part is a pause."""
        return self.first_index == PAUSE


@dataclass(frozen=True, slots=True, kw_only=True)
class Stacked:
    """All parts of a frame in their order, and a mask of the rows that are samples; None if all are."""

    parts: tuple[Part, ...]
    samples: BoolArray | None

    @property
    def stretches(self) -> Iterator[Part]:
        """The parts that are samples."""
        return (part for part in self.parts if not part.is_pause)

    @property
    def is_one_recording(self) -> bool:
        """Whether all stretches belong to one recording."""
        return len({part.origin_s for part in self.parts}) == 1

    def sampled(self, values: FloatArray) -> FloatArray:
        """Return the values at the samples, shape (n,), from those of all rows."""
        return values if self.samples is None else values[self.samples]

    def each(self, signals: Signals, work: Callable[[Signals], Signals]) -> Signals:
        """Apply `work` to the parts in turn, each with the memory of the previous one; a new recording has none."""
        pairs: list[tuple[Signals, Signals]] = []
        memory: Mapping[str, FloatArray] = {}
        origin_s = np.nan
        for part in self.parts:
            before = _cut(signals, part, memory if part.origin_s == origin_s else {})
            after = work(before)
            pairs.append((before, after))
            memory, origin_s = after.memory, part.origin_s
        changed: dict[str, Any] = {
            name: np.concatenate([getattr(after, name) for _, after in pairs])
            for name in _ARRAYS
            if any(getattr(after, name) is not getattr(before, name) for before, after in pairs)
        }
        return replace(signals, **changed)

    def lagged(self, values: FloatArray, time_s: FloatArray, tau_s: float) -> FloatArray:
        """Return the first-order lag of the values of all rows (n,), through all pauses; each recording starts anew."""
        parts = ((part.rows, part.interval_s, part.origin_s) for part in self.parts)
        return lagged_in_parts(values, time_s, parts, tau_s)


def stacked(frame: Frame) -> tuple[Stacked, Signals]:
    """Return the parts of a frame, and its signals before any effect."""
    parts: list[Part] = []
    time_s: list[FloatArray] = []
    begin = 0
    for stretch, rows in enumerate(frame.stretches):
        origin_s = frame.origins_s[stretch]
        pause = frame.pauses[stretch] if frame.pauses else None
        if pause is not None:
            taken = slice(begin, begin + pause.time_s.size)
            parts.append(
                Part(rows=taken, interval_s=pause.interval_s, first_index=PAUSE, origin_s=origin_s, stretch=stretch)
            )
            time_s.append(pause.time_s - origin_s)
            begin = taken.stop
        taken = slice(begin, begin + rows.stop - rows.start)
        parts.append(
            Part(rows=taken, interval_s=frame.interval_s, first_index=rows.start, origin_s=origin_s, stretch=stretch)
        )
        time_s.append(frame.time_s[rows] - origin_s)
        begin = taken.stop
    samples = None
    if any(part.is_pause for part in parts):
        samples = np.concatenate([np.full(part.rows.stop - part.rows.start, not part.is_pause) for part in parts])
    stack = Stacked(parts=tuple(parts), samples=samples)
    return stack, _signals(frame, stack, np.concatenate(time_s))


def _signals(frame: Frame, stack: Stacked, time_s: FloatArray) -> Signals:
    def all_rows(values: FloatArray, of_pauses: Sequence[FloatArray] = ()) -> FloatArray:
        """Return the values of all rows; without `of_pauses`, those of the pauses are 0 (table at rest)."""
        if stack.samples is None:
            return values
        stack_values = np.zeros(stack.samples.size)
        stack_values[stack.samples] = values
        if of_pauses:
            stack_values[~stack.samples] = np.concatenate(of_pauses)
        return stack_values

    pauses = [pause for pause in frame.pauses if pause is not None]
    angle, rate = all_rows(frame.angle_deg), all_rows(frame.rate_dps)
    temp = all_rows(frame.temp_c, [pause.temp_c for pause in pauses])
    return Signals(
        interval_s=frame.interval_s,
        time_s=time_s,
        angle_deg=angle,
        rate_dps=rate,
        acceleration_dps2=all_rows(frame.acceleration_dps2),
        housing_c=temp,
        coil_c=temp,
        sensed_rate_dps=rate,
        output_v=np.zeros(0),
        encoder_deg=angle,
        thermistor_c=temp,
        coil_rate_c_per_s=all_rows(frame.temp_rate_c_per_s, [pause.temp_rate_c_per_s for pause in pauses]),
        auxiliary={name: all_rows(values) for name, values in frame.auxiliary.items()},
    )


def _cut(signals: Signals, part: Part, memory: Mapping[str, FloatArray]) -> Signals:
    rows = part.rows
    return Signals(
        **{name: getattr(signals, name)[rows] for name in _ARRAYS},
        interval_s=part.interval_s,
        first_index=part.first_index,
        auxiliary={name: values[rows] for name, values in signals.auxiliary.items()},
        memory=memory,
    )
