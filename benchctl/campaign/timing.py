"""How long a plan takes and how much it records, computed without an instrument.

A campaign's journal keeps the plan, so that whoever follows the run knows what is still to come: events of kind `plan`,
each with `of` (how many steps the plan has) and a part of them: `steps`, a list of objects with `index` (from 1),
`label`, `kind`, `t_start_s`, `t_end_s` (bench time, if the campaign is played from its beginning), `streamed_s` (how
much of that is streamed) and `setpoint_c` (at the step's end); of a soak also `hold_s`, `tolerance_c` and
`drift_c_per_min`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchctl.bench import Limits
from benchctl.plan import Ask, ConstantRate, Mount, Plan, PowerCycle, Sine, Soak, Static, Step, ThermalRamp

BYTES_PER_SCAN = 10
"""What one scan of four channels takes in a recording, compressed: 8 at the most where the gyro fills its converter."""

BYTES_PER_SCAN_IN_A_PART = 32
"""What a scan takes in the file of the step that is being written: four channels of float64."""

BYTES_PER_STEP = 40_000
"""What a step takes besides its scans: descriptions, digests, polls."""

OPERATOR_S = 120.0
"""Bench time that somebody is taken to need to mount a unit otherwise, or for whatever else is asked."""


def step_s(step: Step, from_c: float, limits: Limits) -> float:
    """Bench time [s] of a step that begins with the chamber at `from_c`; spin-up at half the acceleration limit."""
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
        case Mount() | Ask():
            return OPERATOR_S


def set_point_after(step: Step, before_c: float) -> float:
    """The chamber's set point once a step is over."""
    match step:
        case Soak():
            return step.setpoint_c
        case ThermalRamp():
            return step.to_c
        case _:
            return before_c


def timeline(plan: Plan, limits: Limits, from_c: float) -> Iterator[tuple[float, float, float]]:
    """For each step its start, its end [s of bench time] and the set point [°C] at its end."""
    now_s, setpoint_c = 0.0, from_c
    for step in plan.steps:
        end_s = now_s + step_s(step, setpoint_c, limits)
        setpoint_c = set_point_after(step, setpoint_c)
        yield now_s, end_s, setpoint_c
        now_s = end_s


def disk_bytes(plan: Plan, sample_rate_hz: float) -> int:
    """What the campaign needs on disk at the most: while a step is closed, or while all are gathered in one file."""
    return max(_need_by_step(plan, sample_rate_hz), default=0)


def step_that_fills(plan: Plan, sample_rate_hz: float, free_bytes: float) -> int | None:
    """The step, counted from 1, at which so many free bytes would be used up; None where they are enough."""
    for number, need in enumerate(_need_by_step(plan, sample_rate_hz), 1):
        if need > free_bytes:
            return min(number, len(plan.steps))
    return None


def _need_by_step(plan: Plan, sample_rate_hz: float) -> Iterator[int]:
    """What is needed to close each step, and at last to gather them all.

    A step is closed by writing it once more, compressed; before that its file takes all of it, and room for as much is
    demanded.
    """
    finished = 0
    for step in plan.steps:
        scans = int(step.streamed_s * sample_rate_hz)
        yield finished + 2 * scans * BYTES_PER_SCAN_IN_A_PART + BYTES_PER_STEP
        finished += scans * BYTES_PER_SCAN + BYTES_PER_STEP
    yield 2 * finished


STEPS_A_LINE = 200
"""A line of the journal stays far below what its readers take."""
SOAK = ("hold_s", "tolerance_c", "drift_c_per_min")
"""What a soak waits for."""


def plan_events(plan: Plan, limits: Limits, from_c: float) -> Iterator[dict[str, Any]]:
    """What the events of a plan say, in order; `from_c` is the set point with which it begins."""
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
