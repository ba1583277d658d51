"""What a run is doing, in a word or two."""

from __future__ import annotations

from benchctl.dashboard.data.forecast import planned_step
from benchctl.dashboard.data.readings import Readings
from benchctl.dashboard.data.run_state import RunState

_FAR_C = 0.5
"""From a set point; nearer, the chamber is there."""
_POLLED = {
    "soak": "",
    "power_cycle": "waiting for the unit's supply",
    "mount": "waiting for the unit to be mounted",
    "ask": "waiting for the operator",
}


def doing(state: RunState, readings: Readings) -> str:
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
    if kind != "soak":
        return _POLLED.get(kind) or ("recording" if recording else "moving and settling")
    air_c, setpoint_c = readings.values["air_c"], readings.values["setpoint_c"]
    if not recording or air_c is None or setpoint_c is None:
        return "going to the set point"
    return "going to the set point" if abs(air_c - setpoint_c) > _FAR_C else "soaking"
