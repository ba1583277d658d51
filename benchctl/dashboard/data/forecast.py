"""How far a campaign has come, and when it will be over: by its plan in bench time, by its pace so far on the clock."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

from benchctl.dashboard.data.plan import PlannedStep
from benchctl.dashboard.data.run_state import RunState

_SOON_S = 2.0
"""Wall time after which a pace is known."""
_LONGEST_S = 10 * 365 * 86400.0


def step_now(state: RunState, now_s: float, waits_s: float = 0.0) -> dict[str, Any] | None:
    """The step that is played; None before the first one.

    `ends_s` is when it will be over: as planned, but not before `waits_s` from now; None where there is no plan.
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
    """What the plan says of the step that is played."""
    number = state.step.number if state.step is not None else 0
    return state.plan[number - 1] if 0 < number <= len(state.plan) else None


def left_s(state: RunState, now_s: float, waits_s: float = 0.0) -> float | None:
    """Bench time until the plan is over, with the step that is played as in `step_now`; None where there is no plan."""
    planned = planned_step(state)
    if planned is None or state.step is None:
        return state.plan[-1].t_end_s if state.plan and state.step is None else None
    return _ends_s(planned, state.step.began_s, now_s, waits_s) - now_s + state.plan[-1].t_end_s - planned.t_end_s


def ends_utc(state: RunState, now_s: float, wall_s: float, left: float | None) -> str | None:
    """When `left` seconds of bench time will be over on the wall clock, as fast as it went so far; None: not known."""
    if left is None or state.began is None:
        return None
    bench_s, took_s = now_s - state.began.bench_s, wall_s - state.began.wall_s
    if took_s < _SOON_S or bench_s <= 0.0:
        return None
    wait_s = left * took_s / bench_s
    if wait_s > _LONGEST_S:
        return None
    return (datetime.fromtimestamp(wall_s, UTC) + timedelta(seconds=wait_s)).isoformat(timespec="seconds")
