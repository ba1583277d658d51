"""What a run is doing, in a word or two, and what a soak waits for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from benchctl.bench import Bench
from benchctl.campaign.soak import SoakWatch
from benchctl.dashboard.data.forecast import planned_step
from benchctl.dashboard.data.readings import Readings
from benchctl.dashboard.data.run_state import RunState
from benchctl.dashboard.data.step_feed import News

_POLLED = {
    "power_cycle": "waiting for the unit's supply",
    "mount": "waiting for the unit to be mounted",
    "ask": "waiting for the operator",
}
_LONGEST_S = 1e12


def doing(state: RunState, readings: Readings, soak: SoakWatch | None = None) -> str:
    """What it does, as far as its journal and its files tell."""
    if state.ending:
        return "closing the recording" if state.ending == "closing" else "at rest"
    if state.on_hold:
        return "on hold"
    if state.step is None:
        return "preparing the bench"
    recording = readings.index == state.step.index and readings.recorded
    planned = planned_step(state)
    kind = readings.kind if recording or planned is None else planned.kind
    if kind == "soak":
        return soak.says if soak is not None else "going to the set point"
    return _POLLED.get(kind) or ("recording" if recording else "moving and settling")


class SoakFollower:
    """Follows the soak that is played by its polls, with the rule by which the runner ends it.

    `watch` is None where no soak is played, or where the journal does not say what it waits for.
    """

    def __init__(self) -> None:
        self._index: int | None = None
        self._watch: SoakWatch | None = None

    def take(self, news: News, state: RunState, bench: Bench | None) -> None:
        """Take the new samples of a step into account."""
        if state.step is None or news.info.index != state.step.index:
            return
        if news.info.index != self._index:
            self._index, self._watch = news.info.index, _watch_of(state, news.info.t_start, bench)
        polls = [news.channels.get(f"poll_{name}") for name in ("time_s", "chamber_temp_c", "gyro_temp_c")]
        if self._watch is not None and all(poll is not None for poll in polls):
            for now_s, air_c, gyro_c in zip(*polls, strict=True):
                if math.isfinite(air_c):
                    self._watch.see(float(now_s), float(air_c), float(gyro_c))

    def watch(self, state: RunState) -> SoakWatch | None:
        """The soak that is played now."""
        return self._watch if state.step is not None and state.step.index == self._index else None


def soak_json(watch: SoakWatch | None, readings: Readings) -> dict[str, Any] | None:
    """What a soak waits for, for the page: `left_s` is at least what remains once the air is within the tolerance."""
    if watch is None:
        return None
    step, held_s = watch.step, watch.held_s
    return {
        "air_c": readings.values["air_c"],
        "setpoint_c": step.setpoint_c,
        "tolerance_c": step.tolerance_c,
        "hold_s": step.hold_s,
        "held_s": held_s,
        "left_s": remaining_s(watch),
        "drift_c_per_min": watch.drift_c_per_min,
        "most_drift_c_per_min": step.drift_c_per_min,
    }


def remaining_s(watch: SoakWatch | None) -> float:
    """How much longer the air has to stay within the tolerance [s]; zero where no soak is played."""
    return 0.0 if watch is None else max(0.0, watch.step.hold_s - (watch.held_s or 0.0))


def _watch_of(state: RunState, begin_s: float, bench: Bench | None) -> SoakWatch | None:
    planned = planned_step(state)
    if planned is None or planned.soak is None or bench is None:
        return None
    step = replace(planned.soak, timeout_s=_LONGEST_S)  # how long it may take is the runner's matter
    return SoakWatch(step, from_c=step.setpoint_c, begin_s=begin_s, limits=bench.limits)
