"""The list of steps in an open recording or a map file, and cutting samples into these steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from benchctl.limits import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from benchctl.recordings.model import Step, StepInfo
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Position

UNASSIGNED = "unassigned"
"""The kind of steps with the rows that belong to no step of the list; no fit uses them (role `none`)."""

Kind = Literal["static", "constant_rate", "sine", "thermal_ramp", "motion"]
"""Kinds of steps that the list may contain; `motion` is any other movement, known from the encoder alone."""


def _not_too_slow(rate_hz: float) -> float:
    if rate_hz < LOWEST_RATE_HZ:
        raise ValueError(f"expected a rate of at least {LOWEST_RATE_HZ:g} Hz, got {rate_hz:g} Hz")
    return rate_hz


Rate = Annotated[float, Field(gt=0, le=HIGHEST_RATE_HZ), AfterValidator(_not_too_slow)]
"""A sample rate (Hz) whose inverse is a normal number."""


class StepEntry(BaseModel):
    """One entry of `steps`: from `t_start` until just before `t_end`, in s of the samples' clock.

    Absent times are the first and the last sample, an absent set point is not known. If the unit is not mounted along
    the table's axis, no fit of one axis uses the step, whatever its role.
    """

    model_config = ConfigDict(strict=True, extra="allow", frozen=True, allow_inf_nan=False)

    name: str = Field(min_length=1)
    kind: Kind
    t_start: float | None = None
    t_end: float | None = None
    chamber_setpoint_c: float | None = None
    rate_dps: float | None = None
    amplitude_dps: float | None = Field(default=None, gt=0)
    frequency_hz: float | None = Field(default=None, gt=0)
    role: Literal["fit", "verify", "none"] = "fit"
    mounting: Position = "along"

    @model_validator(mode="after")
    def _is_told_whole(self) -> StepEntry:
        needed = {"constant_rate": ("rate_dps",), "sine": ("amplitude_dps", "frequency_hz")}.get(self.kind, ())
        for key in needed:
            if getattr(self, key) is None:
                raise ValueError(f"a step of kind {self.kind} needs {key}")
        if self.t_start is not None and self.t_end is not None and self.t_end <= self.t_start:
            raise ValueError(f"ends at {self.t_end:g} s, not after its start at {self.t_start:g} s")
        return self

    @property
    def unknown_keys(self) -> dict[str, Any]:
        """The keys of the entry that are not fields."""
        return dict(self.model_extra or {})


def cut_into_steps(
    entries: Sequence[StepEntry],
    channels: Mapping[str, FloatArray],
    *,
    rate_hz: float | None,
    where: Callable[[int], str],
    starts: Sequence[int] = (0,),
) -> list[Step]:
    """Cut samples into steps, in order of time; rows that belong to no entry become steps of kind `unassigned`.

    Parameters
    ----------
    entries
        In any order; if there is none, all rows are unassigned.
    channels
        Including `time_s`, each of shape (n,), n ≥ 1. Steps hold views of them.
    rate_hz
        The uniform rate; None if the stamps are not uniform.
    where
        Number of an entry -> its place in words, for errors.
    starts
        Samples at which stretches without gaps begin; a step that contains such a sample is cut there.

    Raises
    ------
    UsageError
        Two entries overlap, an entry reaches beyond the samples or contains none.
    """
    time = channels["time_s"]
    period = 1.0 / rate_hz if rate_hz else float(np.median(np.diff(time))) if time.size > 1 else 1.0
    order = sorted(range(len(entries)), key=lambda k: _begin(entries[k], time))
    steps: list[Step] = []
    used = 0
    for position, k in enumerate(order):
        entry = entries[k]
        begin, end = _begin(entry, time), _end(entry, time, period)
        if position and begin < (before_end := _end(entries[order[position - 1]], time, period)) - 1e-3 * period:
            raise UsageError(
                f"{where(k)}: {entry.name!r} starts at {begin:g} s, before {entries[order[position - 1]].name!r} "
                f"ends at {before_end:g} s: two steps overlap; correct their times"
            )
        if begin < time[0] - 1e-3 * period or end > time[-1] + 1.001 * period:
            raise UsageError(
                f"{where(k)}: {entry.name!r} from {begin:g} to {end:g} s reaches beyond the samples, "
                f"which go from {time[0]:g} to {time[-1] + period:g} s; correct its times"
            )
        first, last = (int(edge) for edge in np.searchsorted(time, np.array([begin, end]) - 1e-3 * period))
        if first == last:
            raise UsageError(
                f"{where(k)}: {entry.name!r} from {begin:g} to {end:g} s holds no sample; correct its times"
            )
        _append(steps, _unassigned(used), channels, used, first, rate_hz, period, starts)
        _append(steps, entry, channels, first, last, rate_hz, period, starts)
        used = last
    _append(steps, _unassigned(used), channels, used, time.size, rate_hz, period, starts)
    return steps


def _end(entry: StepEntry, time: FloatArray, period: float) -> float:
    """Return when an entry ends (s): as it states, or one period after the last sample."""
    return float(time[-1] + period) if entry.t_end is None else entry.t_end


def _begin(entry: StepEntry, time: FloatArray) -> float:
    return float(time[0]) if entry.t_start is None else entry.t_start


def _unassigned(row: int) -> StepEntry:
    return StepEntry.model_construct(name=f"rows from {row + 1}", kind=UNASSIGNED, role="none")


def _append(
    steps: list[Step],
    entry: StepEntry,
    channels: Mapping[str, FloatArray],
    first: int,
    last: int,
    rate_hz: float | None,
    period: float,
    starts: Sequence[int],
) -> None:
    """Append the samples `first:last`, cut at the `starts` among them; nothing if there are no samples."""
    inner = [start for start in starts if first < start < last]
    edges = [first, *inner, last] if last > first else []
    time, turned = channels["time_s"], entry.mounting != "along"
    for part, (a, b) in enumerate(pairwise(edges), 1):
        steps.append(
            Step(
                StepInfo(
                    index=len(steps) + 1,
                    name=f"{entry.name}, part {part}" if inner else entry.name,
                    kind=entry.kind,
                    role="none" if turned else entry.role,
                    t_start=entry.t_start if a == first and entry.t_start is not None else float(time[a]),
                    t_end=entry.t_end if b == last and entry.t_end is not None else float(time[b - 1] + period),
                    chamber_setpoint_c=math.nan if entry.chamber_setpoint_c is None else entry.chamber_setpoint_c,
                    rate_dps=entry.rate_dps,
                    amplitude_dps=entry.amplitude_dps,
                    frequency_hz=entry.frequency_hz,
                    sample_rate_hz=rate_hz,
                    samples=b - a,
                    mounting=entry.mounting if turned else "",
                ),
                {name: values[a:b] for name, values in channels.items()},
            )
        )
