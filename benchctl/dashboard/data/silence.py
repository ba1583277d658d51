"""Whether a campaign that runs has gone silent: nothing has come for longer than anything it does may take."""

from __future__ import annotations

from benchctl.bench import Bench
from benchctl.dashboard.data.forecast import planned_step
from benchctl.dashboard.data.readings import Readings
from benchctl.dashboard.data.run_state import RunState
from benchctl.recordings.step_writer import CLOSING_S_PER_SCAN

_SILENCE_S = 10.0
"""Where no bench says how long its instruments may be silent."""
_BY_HAND = ("power_cycle", "mount", "ask")


def patience_s(state: RunState, readings: Readings, bench: Bench | None) -> float | None:
    """Wall time without a sample or a line of the journal that is nothing unusual; None while a person is waited for.

    It is the bench's `silence_s`, and more where no sample can come: while the table comes to rest, spins up and
    settles before a step is recorded, while a step's file is written once more, and while all are gathered.
    """
    planned = planned_step(state)
    if state.on_hold or (planned is not None and planned.kind in _BY_HAND):
        return None
    silence_s = bench.limits.silence_s if bench is not None else _SILENCE_S
    if state.ending:
        return silence_s + state.samples * CLOSING_S_PER_SCAN
    if state.step is None or readings.index != state.step.index or not readings.recorded:
        spins_up_s = 4.0 * bench.limits.rate_dps / bench.limits.acceleration_dps2 if bench is not None else 0.0
        settles_s = planned.t_end_s - planned.t_start_s - planned.streamed_s if planned and planned.streamed_s else 0.0
        return silence_s + 10.0 + (spins_up_s + settles_s) / (bench.time_factor if bench is not None else 1.0)
    return silence_s + readings.streamed * CLOSING_S_PER_SCAN
