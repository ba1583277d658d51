"""Where a campaign is, as its journal tells it event by event."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from benchctl.dashboard.data.plan import PlannedStep, plan_in
from benchctl.dashboard.data.told import told_number
from benchctl.limits import LONGEST_TIME_S, cut

Event = Mapping[str, Any]
_LONGEST = 200


@dataclass(frozen=True, slots=True)
class Instant:
    """A moment by the bench's time [s since the start of the recording] and by the wall's [s since 1970]."""

    bench_s: float
    wall_s: float


@dataclass(frozen=True, slots=True)
class BegunStep:
    """The step that is being played: its index in the recording, its number in the plan, and when it began."""

    index: int
    number: int
    label: str
    began_s: float


@dataclass(slots=True)
class RunState:
    """What is known from the events so far.

    `begun` has the bench time at which each step of the plan last began, by its number in the plan.
    `began` is when the program that runs now began, `last` the last moment that was told in both times. `ending` is
    `rest` once the bench was brought to rest, then `closing` while the recording is being closed, else empty.
    """

    plan: tuple[PlannedStep, ...] = ()
    planned: int | None = None
    step: BegunStep | None = None
    begun: dict[int, float] = field(default_factory=dict)
    began: Instant | None = None
    last: Instant | None = None
    on_hold: str = ""
    ending: str = ""
    samples_of: dict[object, int] = field(default_factory=dict)
    _plan_events: list[Event] = field(default_factory=list)

    @property
    def samples(self) -> int:
        """Samples in the steps that are over."""
        return sum(self.samples_of.values())

    def take(self, events: Iterable[Event]) -> None:
        """Take further events into account, in their order."""
        for event in events:
            kind, bench_s = event.get("kind"), told_number(event.get("bench_s"), LONGEST_TIME_S)
            wall_s = _wall_s(event.get("wall_time"))
            if bench_s is not None and wall_s is not None:
                self.last = Instant(bench_s, wall_s)
                if kind == "resume" or self.began is None:
                    self.began = self.last
            if isinstance(event.get("planned"), int):
                self.planned = event["planned"]
            if kind in ("step", "resume"):
                self.on_hold = self.ending = ""
            match kind:
                case "plan":
                    self._take_plan(event)
                case "step":
                    self._take_step(event, bench_s or 0.0)
                case "hold":
                    self.on_hold = str(event.get("says") or "by an interlock") if event.get("on") else ""
                case "whole" | "cut":
                    self._take_samples(event)
                case "safe":
                    self.ending = "rest"
                case "finish" | "recover":
                    self.ending = "closing"

    def _take_plan(self, event: Event) -> None:
        self._plan_events.append(event)
        if whole := plan_in(self._plan_events):
            self.plan, self._plan_events = whole, []

    def _take_step(self, event: Event, bench_s: float) -> None:
        index = event.get("index")
        if isinstance(index, int):
            number = event.get("number")
            label = cut(str(event.get("name", "")), _LONGEST)
            self.step = BegunStep(index, number if isinstance(number, int) else index, label, bench_s)
            self.begun[self.step.number] = bench_s

    def _take_samples(self, event: Event) -> None:
        index, samples = event.get("index"), event.get("samples")
        if isinstance(index, int) and isinstance(samples, int):
            # the same step may be cut again and again, and each attempt is kept
            key = index if event.get("kind") == "whole" else (index, len(self.samples_of))
            self.samples_of[key] = samples


def _wall_s(text: object) -> float | None:
    try:
        moment = datetime.fromisoformat(str(text))
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
