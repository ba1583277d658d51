"""The state of a run according to its journal: its plan, the current step, and the expected end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from benchctl.campaign.timing import SOAK
from benchctl.limits import LONGEST_TIME_S, MOST_JOURNAL_LINES, cut
from benchctl.plan import Soak

_LONGEST_TEXT = 200


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """A step of the plan: its start and end in bench time without delays; its duration of streaming.

    `soak` contains the parameters of a soak, if the journal states them.
    """

    index: int
    label: str
    kind: str
    t_start_s: float
    t_end_s: float
    streamed_s: float
    setpoint_c: float | None
    soak: Soak | None = None

    def as_json(self, began_s: float | None) -> dict[str, Any]:
        """Return the step for the page; `began_s` is its actual start, None before it."""
        names = ("index", "label", "kind", "t_start_s", "t_end_s", "setpoint_c")
        return {**{name: getattr(self, name) for name in names}, "began_s": began_s}


def plan_in(events: Iterable[Mapping[str, Any]]) -> tuple[PlannedStep, ...]:
    """Return the last complete plan in some events; empty if there is none, as in older campaigns."""
    complete: tuple[PlannedStep, ...] = ()
    pieces: list[PlannedStep] = []
    for event in events:
        if event.get("kind") != "plan":
            continue
        steps = [step for entry in _list(event.get("steps")) if (step := _step(entry)) is not None]
        if steps and steps[0].index == 1:
            pieces = []
        pieces += steps
        if len(pieces) == event.get("of") and [step.index for step in pieces] == list(range(1, len(pieces) + 1)):
            complete = tuple(pieces)
        if len(pieces) > MOST_JOURNAL_LINES:
            break
    return complete


def _list(data: object) -> list[Any]:
    return data if isinstance(data, list) else []


def _step(data: object) -> PlannedStep | None:
    if not isinstance(data, dict):
        return None
    index, start_s, end_s = data.get("index"), number_of(data.get("t_start_s")), number_of(data.get("t_end_s"))
    if not isinstance(index, int) or start_s is None or end_s is None:
        return None
    return PlannedStep(
        index=index,
        label=cut(str(data.get("label", "")), _LONGEST_TEXT),
        kind=cut(str(data.get("kind", "")), _LONGEST_TEXT),
        t_start_s=start_s,
        t_end_s=end_s,
        streamed_s=number_of(data.get("streamed_s")) or 0.0,
        setpoint_c=number_of(data.get("setpoint_c")),
        soak=_soak(data),
    )


def _soak(data: Mapping[str, Any]) -> Soak | None:
    setpoint_c, *numbers = (number_of(data.get(name)) for name in ("setpoint_c", *SOAK))
    if setpoint_c is None or None in numbers:
        return None
    hold_s, tolerance_c, drift_c_per_min = (number or 0.0 for number in numbers)
    return Soak(setpoint_c=setpoint_c, hold_s=hold_s, tolerance_c=tolerance_c, drift_c_per_min=drift_c_per_min)


def number_of(value: object, most: float = math.inf) -> float | None:
    """Return the value as a number; None if it is not one, not finite, or larger than `most`."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) and abs(number) <= most else None


Event = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Instant:
    """A moment in bench time [s since the start of the recording] and wall time [s since 1970]."""

    bench_s: float
    wall_s: float


@dataclass(frozen=True, slots=True)
class BegunStep:
    """The current step: its index in the recording, its number in the plan, and its start."""

    index: int
    number: int
    label: str
    began_s: float


@dataclass(slots=True)
class RunState:
    """The state after the events so far.

    `begun` has the bench time of the last start of each step of the plan, by its number in the plan. `began` is the
    start of the current program, `last` the last moment with both times. `ending` is `rest` after the bench was brought
    to rest, then `closing` while the recording is being closed, else empty.
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
        """The number of samples in finished steps."""
        return sum(self.samples_of.values())

    def take(self, events: Iterable[Event]) -> None:
        """Process further events in their order."""
        for event in events:
            kind, bench_s = event.get("kind"), number_of(event.get("bench_s"), LONGEST_TIME_S)
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
        if complete := plan_in(self._plan_events):
            self.plan, self._plan_events = complete, []

    def _take_step(self, event: Event, bench_s: float) -> None:
        index = event.get("index")
        if isinstance(index, int):
            number = event.get("number")
            label = cut(str(event.get("name", "")), _LONGEST_TEXT)
            self.step = BegunStep(index, number if isinstance(number, int) else index, label, bench_s)
            self.begun[self.step.number] = bench_s

    def _take_samples(self, event: Event) -> None:
        index, samples = event.get("index"), event.get("samples")
        if isinstance(index, int) and isinstance(samples, int):
            # a step may be cut several times, and each attempt is kept
            key = index if event.get("kind") == "whole" else (index, len(self.samples_of))
            self.samples_of[key] = samples


def _wall_s(text: object) -> float | None:
    try:
        moment = datetime.fromisoformat(str(text))
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


_SOON_S = 2.0
"""Minimum wall time for an estimate of the pace."""
_LONGEST_FORECAST_S = 10 * 365 * 86400.0


def step_now(state: RunState, now_s: float, waits_s: float = 0.0) -> dict[str, Any] | None:
    """Return the current step; None before the first one.

    `ends_s` is its expected end: as planned, but at least `waits_s` from now; None without a plan.
    """
    if state.step is None:
        return None
    planned = planned_step(state)
    return {
        "index": state.step.number,
        "count": len(state.plan) or state.planned,
        "label": state.step.label,
        "kind": planned.kind if planned is not None else "",
        "began_s": state.step.began_s,
        "ends_s": None if planned is None else _ends_s(planned, state.step.began_s, now_s, waits_s),
    }


def _ends_s(planned: PlannedStep, began_s: float, now_s: float, waits_s: float) -> float:
    return max(began_s + planned.t_end_s - planned.t_start_s, now_s + waits_s)


def planned_step(state: RunState) -> PlannedStep | None:
    """Return the current step in the plan."""
    number = state.step.number if state.step is not None else 0
    return state.plan[number - 1] if 0 < number <= len(state.plan) else None


def left_s(state: RunState, now_s: float, waits_s: float = 0.0) -> float | None:
    """Return the bench time until the end of the plan, with the current step as in `step_now`; None without a plan."""
    planned = planned_step(state)
    if planned is None or state.step is None:
        return state.plan[-1].t_end_s if state.plan and state.step is None else None
    return _ends_s(planned, state.step.began_s, now_s, waits_s) - now_s + state.plan[-1].t_end_s - planned.t_end_s


def ends_utc(state: RunState, now_s: float, wall_s: float, left: float | None) -> str | None:
    """Return the wall time after `left` seconds of bench time, at the average pace so far; None if it is not known."""
    if left is None or state.began is None:
        return None
    bench_s, took_s = now_s - state.began.bench_s, wall_s - state.began.wall_s
    if took_s < _SOON_S or bench_s <= 0.0:
        return None
    wait_s = left * took_s / bench_s
    if wait_s > _LONGEST_FORECAST_S:
        return None
    return (datetime.fromtimestamp(wall_s, UTC) + timedelta(seconds=wait_s)).isoformat(timespec="seconds")
