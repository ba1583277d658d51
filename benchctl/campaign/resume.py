"""Resume a campaign that a crash or a stop ended early: complete steps, the next step, and what to do before it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path

from benchctl.bench import Bench
from benchctl.campaign.differences import refuse_another
from benchctl.campaign.opened import another_day, as_drawn
from benchctl.campaign.provenance import recorded_bench
from benchctl.limits import LONGEST_TIME_S
from benchctl.locks import Lock
from benchctl.plan import Mount, Plan, PowerCycle, Soak, Step, ThermalRamp
from benchctl.plan.steps import positions
from benchctl.recordings.campaign_folder import CampaignWriter, campaign_lock
from benchctl.recordings.hdf5_guard import note_ended
from benchctl.recordings.journal import Events, events_in, journal_text
from benchctl.recordings.model import Meta, StepInfo
from benchctl.recordings.reader import described, require_campaign
from benchctl.recordings.recover import free_index, reopen, sound_steps
from benchctl.recordings.schema import JOURNAL
from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Position

PLAIN_SOAK_S = 600.0
"""Time for which a set point that the plan had reached without a soak is held again; the gyro's drift may extend it."""

_APART_S = 1.0
"""Minimum time between the last recorded time and the resumed recording, whatever the clocks show."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SoakAgain(Soak):
    """The soak that restores the chamber's state before a step that is not the campaign's first."""

    before_step: int

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return f"soak at {self.setpoint_c:+g} again, before step {self.before_step}"


@dataclass(frozen=True, slots=True, kw_only=True)
class MountAgain(Mount):
    """The mounting that restores the unit's position before a step that is not the campaign's first."""

    before_step: int

    @property
    def label(self) -> str:
        """See `BaseStep`."""
        return f"mount {self.position} again, before step {self.before_step}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Past:
    """The existing part of a campaign of `plan`, with its lock held; `bench` is the one to resume it on.

    `first` is the first step that is not complete, counted from 1, or the number of steps plus one. `elapsed_s` is the
    time in the recording at which it resumes. `day` counts how often it was started before.
    """

    folder: Path
    lock: Lock
    meta: Meta
    plan: Plan
    bench: Bench
    infos: tuple[StepInfo, ...]
    first: int
    elapsed_s: float
    day: int

    @property
    def is_whole(self) -> bool:
        """Whether every planned step is complete."""
        return self.first > len(self.plan.steps)

    @property
    def may_be_off(self) -> bool:
        """Whether it may have ended with the unit's supply off: in a power cycle that is still to be played."""
        return not self.is_whole and isinstance(self.plan.steps[self.first - 1], PowerCycle)

    def reopen(self) -> tuple[CampaignWriter, list[StepInfo]]:
        """Return a writer of the folder, ready for the next step, and the existing steps."""
        return reopen(self.folder, len(self.plan.steps), self.lock)


@contextmanager
def past_of(folder: Path, plan: Plan, bench: Bench, *, seeded: bool = False) -> Iterator[Past]:
    """Yield a campaign's past, with its lock held while the block runs.

    On a simulated bench the campaign's own seed is used, unless `seeded` states that `bench` has one to compare. Raises
    `UsageError` if the folder contains no campaign, is being written, or was started with something else.
    """
    require_campaign(folder)
    lock = campaign_lock(folder)
    lock.acquire("benchctl run --resume")
    note_ended(folder)
    try:
        try:
            past = _look_back(folder, lock, plan, bench, seeded)
        except (AttributeError, KeyError, TypeError, ValueError) as err:
            raise UsageError(
                f"--resume {folder}: its description is damaged ({type(err).__name__}: {err}); benchctl verify names "
                "what changed"
            ) from err
        yield past
    finally:
        lock.release()


def steps_to_play(plan: Plan, infos: Sequence[StepInfo], safe_c: float) -> Iterator[tuple[int, int, Step]]:
    """Yield index in the recording, number in the plan, and step, of everything that is still to be played, in order.

    `infos` are the existing steps, `safe_c` is the set point with which the plan begins.
    """
    complete = whole_steps(plan, infos)
    index = free_index(infos, len(plan.steps))
    mounted = tuple(positions(plan.steps))
    # a unit that was not left along the table's axis may have been removed since
    current: Position | None = None if complete and mounted[max(complete) - 1] != "along" else "along"
    for number, (step, position) in enumerate(zip(plan.steps, mounted, strict=True), 1):
        if number in complete:
            continue
        if position != current and not isinstance(step, Mount):
            yield index, number, MountAgain(position=position, before_step=number)
            index += 1
        current = position
        if number - 1 in complete and not isinstance(step, Soak):
            yield index, number, soak_before(plan, number, safe_c)
            index += 1
        yield number, number, step


def whole_steps(plan: Plan, infos: Sequence[StepInfo]) -> dict[int, StepInfo]:
    """Return the planned steps that are complete, by number."""
    return {info.index: info for info in infos if info.whole and info.index <= len(plan.steps)}


def soak_before(plan: Plan, number: int, safe_c: float) -> SoakAgain:
    """Return the soak that restores the chamber's state before a step: the plan's last, or a plain one after a ramp."""
    for step in reversed(plan.steps[: number - 1]):
        if isinstance(step, Soak):
            settings = {item.name: getattr(step, item.name) for item in fields(step)}
            return SoakAgain(**settings, before_step=number)
        if isinstance(step, ThermalRamp):
            return SoakAgain(setpoint_c=step.to_c, hold_s=PLAIN_SOAK_S, before_step=number)
    return SoakAgain(setpoint_c=safe_c, hold_s=PLAIN_SOAK_S, before_step=number)


def _look_back(folder: Path, lock: Lock, plan: Plan, bench: Bench, seeded: bool) -> Past:
    meta = described(folder)
    infos = sound_steps(folder)
    complete = whole_steps(plan, infos)
    if bench.simulated and not seeded and "bench_physics" in meta.provenance:
        bench = as_drawn(bench, recorded_bench(meta, "the campaign").physics)
    refuse_another(meta, complete, plan, bench)
    journal = journal_text(folder / JOURNAL)
    day = 1 + sum(event.get("kind") == "resume" for event in events_in(journal))
    numbers = range(1, len(plan.steps) + 1)
    return Past(
        folder=folder,
        lock=lock,
        meta=meta,
        plan=plan,
        bench=another_day(bench, day) if bench.simulated else bench,
        infos=infos,
        first=next((number for number in numbers if number not in complete), len(plan.steps) + 1),
        elapsed_s=elapsed_s(bench, infos, events_in(journal)),
        day=day,
    )


def elapsed_s(bench: Bench, infos: Sequence[StepInfo], events: Events) -> float:
    """Return the bench time since the start of the recording; on a real bench the wall clock continues to count."""
    known_s = max((info.t_end for info in infos), default=0.0)
    by_the_wall_s = 0.0
    for event in events:
        bench_s = event.get("bench_s")
        if isinstance(bench_s, int | float) and abs(bench_s) <= LONGEST_TIME_S:
            known_s = max(known_s, bench_s)
            by_the_wall_s = bench_s + _seconds_since(str(event.get("wall_time", ""))) * bench.time_factor
    return max(known_s + _APART_S, 0.0 if bench.simulated else by_the_wall_s)


def _seconds_since(wall_time: str) -> float:
    """Return the wall time since a time in ISO 8601; 0 if it is not valid."""
    try:
        return (datetime.now(UTC) - datetime.fromisoformat(wall_time)).total_seconds()
    except (ValueError, TypeError):
        return 0.0
