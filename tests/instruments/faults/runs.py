"""One cell of the matrix where the driver alone cannot tell: a short campaign on real wires, with a fault."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.bench import Bench, load_bench
from benchctl.bench_instruments import GyroEntry, InstrumentEntry
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.plan import ConstantRate, Plan, Soak
from benchctl.recordings.reader import Recording, open_recording
from benchctl_instruments.errors import BenchNotReadyError
from benchctl_instruments.simulated.faults.schedule import FaultTable
from tests.instruments.faults.cells import GAP, RECOVERED, STOPPED, Outcome
from tests.instruments.faults.dialogues import WrongError
from tests.instruments.faults.kinds import SOAKED_TO_C
from tests.instruments.faults.rows import Row

TURN = ConstantRate(rate_dps=50.0, duration_s=30.0, settle_s=1.0)
COUNTS_PER_REV = 360_000
FRAME_RATE_HZ = 250.0
SOAK = Soak(setpoint_c=SOAKED_TO_C, hold_s=60.0, drift_c_per_min=10.0, timeout_s=600.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What came of a run, and the kinds of events in its journal."""

    outcome: Outcome
    events: tuple[str, ...]


def run_with(row: Row, fault: FaultTable, folder: Path) -> Run:
    """Run a short campaign with a fault, and say what came of it.

    Raises `WrongError` where the fault did not happen, or the bench is not truly at rest and sent home at the end.
    """
    bench = _bench(row, fault)
    plan = Plan(procedure="mine", parameters={}, steps=(TURN, SOAK), calibrates=False)
    try:
        with open_bench(bench) as opened:
            outcome = run_campaign(plan, opened, folder)
            assert opened.simulated is not None
            world, fired = opened.simulated.world, opened.simulated.fired
            opened.clock.sleep(60.0)
            rate_dps, setpoint_c = world.table.motion().rate_dps, world.chamber.setpoint_c()
    except BenchNotReadyError as err:
        return Run(outcome=Outcome(what=STOPPED, why=str(err)), events=())
    if not fired and fault.kind != "clock_drift":
        raise WrongError(f"{fault.kind} never happened to {row.model}: {outcome.error}")
    if abs(rate_dps) > 0.01 or abs(setpoint_c - bench.safe.chamber_c) > 0.06:
        raise WrongError(f"not at rest: the table turns at {rate_dps:g} deg/s, the set point is {setpoint_c:g} °C")
    with open_recording(outcome.recording) as recording:
        gaps = sum(info.gaps for info in recording.infos)
        frames_lost = sum(info.frames_lost or 0 for info in recording.infos)
        if row.kind == "gyro" and outcome.error is None:
            _refuse_miscounted(recording, frames_lost)
        lost = sum(round(TURN.duration_s * 500.0) - info.samples for info in recording.infos if info.rate_dps)
        journal = str(recording.meta.provenance["journal"])
    events = tuple(json.loads(line)["kind"] for line in journal.splitlines())
    if outcome.error is not None:
        return Run(outcome=Outcome(what=STOPPED, why=str(outcome.error)), events=events)
    if bool(gaps) != bool(lost):
        raise WrongError(f"{lost} scans are missing, and {gaps} gaps are marked")
    return Run(outcome=Outcome(what=GAP if gaps or frames_lost else RECOVERED, lost=lost + frames_lost), events=events)


def _refuse_miscounted(recording: Recording, lost: int) -> None:
    """Raise `WrongError` where frames are neither there nor told as lost, but for one at the edge."""
    turned = recording.step(1)["frame_rate_dps"]
    if abs(turned.size + lost - TURN.duration_s * FRAME_RATE_HZ) > 1:
        raise WrongError(f"{turned.size} frames are there, {lost} are told as lost")
    if abs(turned - turned.mean()).max() > 1.0:
        raise WrongError("a frame that is none was taken for one")


def _bench(row: Row, fault: FaultTable) -> Bench:
    bench = load_bench("simulated")
    options: dict[str, Any] = dict(row.options)
    options.pop("fastest_counts_per_s", None)  # a campaign states it by itself
    if row.kind == "gyro":
        entry: InstrumentEntry = GyroEntry(model=row.model, options=options, frame_rate_hz=FRAME_RATE_HZ)
    elif row.kind == "digitizer":
        entry = bench.digitizer.model_copy(update={"model": row.model, "options": options})
    else:
        entry = InstrumentEntry.model_construct(model=row.model, options=options)
    limits = bench.limits.model_copy(update={"silence_s": 1.0})
    return bench.model_copy(update={row.kind: entry, "faults": (fault,), "limits": limits})
