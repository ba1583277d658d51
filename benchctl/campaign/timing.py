"""Compute how long a plan takes and how much it records, without an instrument.

A campaign's journal contains the plan, so that a viewer of the run knows the steps to come: events of kind `plan`, each
with `of` (the number of steps in the plan) and some of the steps: `steps`, a list of objects with `index` (from 1),
`label`, `kind`, `t_start_s`, `t_end_s` (bench time, if the campaign is played from its beginning), `streamed_s` (the
streamed part of that time) and `setpoint_c` (at the step's end); for a soak also `hold_s`, `tolerance_c` and
`drift_c_per_min`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchctl.bench import Limits
from benchctl.plan import Ask, ConstantRate, Home, Mount, Plan, PowerCycle, Sine, Soak, Static, Step, ThermalRamp

BYTES_PER_SCAN = 10
"""Compressed size of a four-channel scan in a recording: at most 8 if the gyro uses the converter's full range."""

BYTES_PER_SCAN_IN_A_PART = 32
"""Size of a scan in the file of the step that is being written: four channels of float64."""

BYTES_PER_STEP = 40_000
"""Size of a step in addition to its scans: descriptions, digests, polls."""

OPERATOR_S = 120.0
"""Bench time assumed for an operator's action, such as mounting a unit in another position."""


def step_s(step: Step, from_c: float, limits: Limits) -> float:
    """Return the bench time [s] of a step, the chamber at `from_c` at first; spin-up at half the acceleration limit."""
    spin_up_s = 2 * step.peak_rate_dps / (0.5 * limits.acceleration_dps2)
    match step:
        case Soak():
            return step.hold_s + abs(step.setpoint_c - from_c) / limits.ramp_c_per_min * 60.0
        case Sine():
            return step.streamed_s + spin_up_s + step.settle_cycles / step.frequency_hz
        case Static() | ConstantRate() | ThermalRamp():
            return step.streamed_s + spin_up_s + step.settle_s
        case PowerCycle():
            return step.off_s
        case Mount() | Ask() | Home():
            return OPERATOR_S


def set_point_after(step: Step, before_c: float) -> float:
    """Return the chamber's set point at the end of a step."""
    match step:
        case Soak():
            return step.setpoint_c
        case ThermalRamp():
            return step.to_c
        case _:
            return before_c


def timeline(plan: Plan, limits: Limits, from_c: float) -> Iterator[tuple[float, float, float]]:
    """Yield, for each step, its start and end [s of bench time] and the set point [°C] at its end."""
    now_s, setpoint_c = 0.0, from_c
    for step in plan.steps:
        end_s = now_s + step_s(step, setpoint_c, limits)
        setpoint_c = set_point_after(step, setpoint_c)
        yield now_s, end_s, setpoint_c
        now_s = end_s


def disk_bytes(plan: Plan, sample_rate_hz: float) -> int:
    """Return the maximum disk space for the campaign: while a step is closed, or while all are gathered in one file."""
    return max(_need_by_step(plan, sample_rate_hz), default=0)


def step_that_fills(plan: Plan, sample_rate_hz: float, free_bytes: float) -> int | None:
    """Return the step, counted from 1, at which the free bytes are used up; None if they are enough."""
    for number, need in enumerate(_need_by_step(plan, sample_rate_hz), 1):
        if need > free_bytes:
            return min(number, len(plan.steps))
    return None


def _need_by_step(plan: Plan, sample_rate_hz: float) -> Iterator[int]:
    """Yield the bytes needed to close each step, and finally to gather all steps.

    A step is closed by writing it again, compressed; until then its file has its full size, and the same room is
    required again.
    """
    finished = 0
    for step in plan.steps:
        scans = int(step.streamed_s * sample_rate_hz)
        yield finished + 2 * scans * BYTES_PER_SCAN_IN_A_PART + BYTES_PER_STEP
        finished += scans * BYTES_PER_SCAN + BYTES_PER_STEP
    yield 2 * finished


STEPS_A_LINE = 200
"""A line of the journal stays far below the limit of its readers."""
SOAK = ("hold_s", "tolerance_c", "drift_c_per_min")
"""What a soak waits for."""


def plan_events(plan: Plan, limits: Limits, from_c: float) -> Iterator[dict[str, Any]]:
    """Yield the data of the journal events of a plan, in order; `from_c` is the set point with which it begins."""
    times = timeline(plan, limits, from_c)
    steps = [
        {
            "index": index,
            "label": step.label,
            "kind": step.kind,
            "t_start_s": round(start_s, 3),
            "t_end_s": round(end_s, 3),
            "streamed_s": round(step.streamed_s, 3),
            "setpoint_c": setpoint_c,
            **({name: getattr(step, name) for name in SOAK} if isinstance(step, Soak) else {}),
        }
        for index, (step, (start_s, end_s, setpoint_c)) in enumerate(zip(plan.steps, times, strict=True), 1)
    ]
    for first in range(0, len(steps), STEPS_A_LINE):
        yield {"of": len(steps), "steps": steps[first : first + STEPS_A_LINE]}
