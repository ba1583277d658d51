"""The plan of a campaign, as its journal has it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from benchctl.campaign.plan_events import SOAK
from benchctl.dashboard.data.told import told_number
from benchctl.limits import MOST_JOURNAL_LINES, cut
from benchctl.plan import Soak

_LONGEST = 200


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """A step of the plan: when it begins and ends in bench time, if nothing delays it; how long it streams.

    `soak` is what a soak waits for, where the journal says so.
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
        """The step for the page; `began_s` is when it really began, None where it has not."""
        names = ("index", "label", "kind", "t_start_s", "t_end_s", "setpoint_c")
        return {**{name: getattr(self, name) for name in names}, "began_s": began_s}


def plan_in(events: Iterable[Mapping[str, Any]]) -> tuple[PlannedStep, ...]:
    """The last plan among some events, whole; empty where there is none, as in campaigns before plans were noted."""
    whole: tuple[PlannedStep, ...] = ()
    pieces: list[PlannedStep] = []
    for event in events:
        if event.get("kind") != "plan":
            continue
        steps = [step for told in _list(event.get("steps")) if (step := _step(told)) is not None]
        if steps and steps[0].index == 1:
            pieces = []
        pieces += steps
        if len(pieces) == event.get("of") and [step.index for step in pieces] == list(range(1, len(pieces) + 1)):
            whole = tuple(pieces)
        if len(pieces) > MOST_JOURNAL_LINES:
            break
    return whole


def _list(told: object) -> list[Any]:
    return told if isinstance(told, list) else []


def _step(told: object) -> PlannedStep | None:
    if not isinstance(told, dict):
        return None
    index, start_s, end_s = told.get("index"), told_number(told.get("t_start_s")), told_number(told.get("t_end_s"))
    if not isinstance(index, int) or start_s is None or end_s is None:
        return None
    return PlannedStep(
        index=index,
        label=cut(str(told.get("label", "")), _LONGEST),
        kind=cut(str(told.get("kind", "")), _LONGEST),
        t_start_s=start_s,
        t_end_s=end_s,
        streamed_s=told_number(told.get("streamed_s")) or 0.0,
        setpoint_c=told_number(told.get("setpoint_c")),
        soak=_soak(told),
    )


def _soak(told: Mapping[str, Any]) -> Soak | None:
    setpoint_c, *numbers = (told_number(told.get(name)) for name in ("setpoint_c", *SOAK))
    if setpoint_c is None or None in numbers:
        return None
    hold_s, tolerance_c, drift_c_per_min = (number or 0.0 for number in numbers)
    return Soak(setpoint_c=setpoint_c, hold_s=hold_s, tolerance_c=tolerance_c, drift_c_per_min=drift_c_per_min)
