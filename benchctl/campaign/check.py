"""Check a plan against a bench's limits and its certificates, before anything moves."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from benchctl.atomic import free_bytes
from benchctl.bench import Bench
from benchctl.campaign.timing import disk_bytes, step_that_fills, timeline
from benchctl.certificates import Expired, expired
from benchctl.plan import Home, Mount, Plan, Soak, Step, ThermalRamp
from benchctl.plan.steps import Polled, faults
from benchctl.recordings.schema import CAMPAIGN, RECORDING
from benchctl_instruments.catalog import counts_encoder, fastest_hz, homes, oscillates
from benchctl_instruments.errors import UsageError
from benchctl_instruments.mounting import AXIS_POSITIONS

_NUMBER = re.compile(r"[+-]?\d[\d.e+-]*")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanProblem:
    """A problem of a plan, and the first step that has it; `step` counts from 1."""

    step: int
    message: str


def problems(plan: Plan, bench: Bench) -> list[PlanProblem]:
    """Return all problems of a plan on this bench; problems that differ only in numbers are merged into one."""
    swings = any(step.peak_acceleration_dps2 for step in plan.steps)
    sinusoids = not swings or oscillates(bench.rate_table.model)
    first: dict[str, PlanProblem] = {}
    count = Counter[str]()
    for number, step in enumerate(plan.steps, 1):
        for fault in tuple(faults(step)) or tuple(_beyond(step, bench, sinusoids)):
            kind = _NUMBER.sub("", fault)
            count[kind] += 1
            first.setdefault(kind, PlanProblem(step=number, message=f"{step.label}: {fault}"))
    return [
        PlanProblem(
            step=each.step,
            message=f"{each.message}{f'; {more} more steps have this problem' if (more := count[kind] - 1) else ''}",
        )
        for kind, each in first.items()
    ]


def room_problems(plan: Plan, bench: Bench, folder: Path) -> list[PlanProblem]:
    """Return a problem if the disk has no room for what a plan records in `folder`, with the step that fills the disk.

    The existing files of a resumed campaign count as free space.
    """
    rate_hz = bench.recorded_hz
    free = free_bytes(folder)
    if (folder / CAMPAIGN).exists() or (folder / RECORDING).exists():
        free += sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    fills = step_that_fills(plan, rate_hz, free)
    if fills is None:
        return []
    needs = disk_bytes(plan, rate_hz)
    message = (
        f"{plan.steps[fills - 1].label}: the disk would be full: the campaign needs {needs / 1e6:.0f} MB, "
        f"{free / 1e6:.0f} MB are free at {folder}; make room or choose another folder"
    )
    return [PlanProblem(step=fills, message=message)]


def refuse_problems(plan: Plan, bench: Bench, folder: Path) -> None:
    """Raise `UsageError` with the first problem and the number of further ones if a plan cannot be run.

    `folder` is the folder that the campaign will be written to.
    """
    found = problems(plan, bench) or room_problems(plan, bench, folder)
    if found:
        raise UsageError(refusal(plan, found))


def refusal(plan: Plan, found: Sequence[PlanProblem]) -> str:
    """Return in one line why a plan cannot be run: the first problem and the number of further ones."""
    more = f"; {len(found) - 1} more problems, which benchctl check lists" if len(found) > 1 else ""
    return f"procedure {plan.procedure}, step {found[0].step}: {found[0].message}{more}"


def bench_time_s(plan: Plan, bench: Bench) -> float:
    """Return the duration of the plan on this bench, with the chamber at the safe set point at the start."""
    return max((end_s for _, end_s, _ in timeline(plan, bench.limits, bench.safe.chamber_c)), default=0.0)


def _beyond(step: Step, bench: Bench, sinusoids: bool) -> Iterator[str]:
    limits = bench.limits
    if step.peak_acceleration_dps2 and not sinusoids:
        yield (
            f"swings, and the bench's table, {bench.rate_table.model}, has no sinusoid; take a procedure of constant "
            "rates (rate_sweep, temperature_sweep) or one at rest (static)"
        )
    if step.peak_rate_dps > limits.rate_dps:
        yield f"reaches {step.peak_rate_dps:g} deg/s, the bench's limit is {limits.rate_dps:g} deg/s (limits.rate_dps)"
    if step.peak_acceleration_dps2 > limits.acceleration_dps2:
        yield (
            f"reaches {step.peak_acceleration_dps2:.0f} deg/s², "
            f"the bench's limit is {limits.acceleration_dps2:g} deg/s² (limits.acceleration_dps2)"
        )
    for celsius in _temperatures(step):
        if not limits.coldest_c <= celsius <= limits.hottest_c:
            yield (
                f"goes to {celsius:g} °C, the bench's limits are {limits.coldest_c:g} to {limits.hottest_c:g} °C "
                "(limits.coldest_c, limits.hottest_c)"
            )
    if isinstance(step, Mount) and step.position in AXIS_POSITIONS and (bench.gyro is None or bench.gyro.axes != 3):
        yield "turns a unit of three axes, and the bench has none; state axes = 3 in the table [gyro] of bench.toml"
    if isinstance(step, Home) and not homes(bench.rate_table.model):
        yield (
            f"homes the table, and the bench's table, {bench.rate_table.model}, has no home; leave the step out, or "
            "home it at its controller"
        )
    if not isinstance(step, Polled):
        yield from _beyond_digitizer(step, bench)
    if isinstance(step, ThermalRamp) and step.ramp_c_per_min > limits.ramp_c_per_min:
        yield (
            f"ramps at {step.ramp_c_per_min:g} °C/min, the bench's limit is {limits.ramp_c_per_min:g} °C/min "
            "(limits.ramp_c_per_min)"
        )


def _beyond_digitizer(step: Step, bench: Bench) -> Iterator[str]:
    model, rate_hz = bench.digitizer.model, bench.digitizer.sample_rate_hz
    if rate_hz > (most_hz := fastest_hz(model)):
        yield (
            f"is recorded at {rate_hz:g} Hz, and the bench's digitizer, {model}, scans at most {most_hz:g} times a "
            "second; lower sample_rate_hz in [digitizer]"
        )
    if not counts_encoder(model) and step.peak_acceleration_dps2:
        yield (
            f"swings, and the bench's digitizer, {model}, counts no encoder and is too slow for sinusoids; take a "
            "procedure of constant rates (rate_sweep, temperature_sweep) or one at rest (static)"
        )
    if not counts_encoder(model) and bench.by_hand:
        yield f"turns by hand, measured by the encoder, and the bench's digitizer, {model}, counts none; take another"
    if round(step.streamed_s * rate_hz) == 0:
        yield f"is too short for a single sample at {rate_hz:g} Hz; make it longer"


def _temperatures(step: Step) -> tuple[float, ...]:
    match step:
        case Soak():
            return (step.setpoint_c,)
        case ThermalRamp():
            return (step.from_c, step.to_c)
        case _:
            return ()


_LONGEST_S = 100 * 365.25 * 86400.0
"""Upper limit of the remaining time: no certificate is valid for longer, and dates have a maximum."""


def expiring(plan: Plan, bench: Bench, first: int = 1) -> tuple[Expired, ...]:
    """Return the instruments whose certificate has expired today (UTC), or expires before a plan started now has ended.

    `first` is the step, counted from 1, at which the plan starts.
    """
    before = replace(plan, steps=plan.steps[: first - 1])
    left_s = (bench_time_s(plan, bench) - bench_time_s(before, bench)) / bench.time_factor
    now = datetime.now(UTC)
    ends = now + timedelta(seconds=min(left_s, _LONGEST_S))
    return expired(bench.entries, now.date(), ends.date())


def as_event(expired: Expired) -> dict[str, str]:
    """Return the data of the journal event for an expired certificate."""
    return {
        "instrument": expired.role,
        "serial": expired.serial,
        "calibrated_until": expired.calibrated_until.isoformat(),
        "says": expired.message,
    }
