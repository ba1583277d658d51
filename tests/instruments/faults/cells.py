"""One cell of the matrix: a driver on real wires, a fault, and what came of it."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from benchctl_instruments.catalog import driver
from benchctl_instruments.errors import BenchError, LinkError, UsageError
from benchctl_instruments.interfaces import TableState
from benchctl_instruments.links.wirelog import logger
from benchctl_instruments.simulated.bench import SimulatedBench
from benchctl_instruments.simulated.clock import VirtualClock
from benchctl_instruments.simulated.faults.schedule import FaultTable
from benchctl_instruments.simulated.settings import WorldSettings
from tests.instruments.faults.dialogues import PUT_THROUGH, WrongError
from tests.instruments.faults.rows import Row

IMPOSSIBLE = "cannot happen"
RECOVERED = "recovered"
GAP = "recovered, a gap is marked"
STOPPED = "stopped"
PATIENCE_S = 3.0  # wall time in which a fault must be over


class NeverHappenedError(AssertionError):
    """The dialogue has no operation at which the fault was due."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of a fault: one of the words above; why, in one line; scans that are missing; exchanges repeated."""

    what: str
    why: str = ""
    lost: int = 0
    repeated: int = 0


def befallen(row: Row, fault: FaultTable) -> Outcome:
    """Put a driver through its dialogue with a fault, and say what came of it.

    Raises `WrongError` where the driver went on with something that is not so, or the bench could not be brought to
    rest through the same driver afterwards, `NeverHappenedError` where the fault did not happen.
    """
    clock = VirtualClock()
    models = {"rate_table": "acutrol3000", "chamber": "watlow_f4t", "digitizer": "labjack_t7", row.kind: row.model}
    try:
        bench = SimulatedBench(WorldSettings(), clock, **models, faults=(fault,))
    except UsageError as err:
        return Outcome(what=IMPOSSIBLE, why=str(err))
    with bench, _repetitions() as repeated:
        options = dict(row.options)
        if row.has_packets:
            options["stream_address"] = bench.addresses["digitizer_stream"]
        instrument = driver(row.kind, row.model)(bench.addresses[row.kind], clock=clock, **options)
        try:
            with instrument:
                lost = PUT_THROUGH[row.kind](instrument, bench)
            outcome = Outcome(what=GAP if lost else RECOVERED, lost=lost, repeated=len(repeated))
        except BenchError as err:
            outcome = Outcome(what=STOPPED, why=str(err), repeated=len(repeated))
            _bring_to_rest(row, instrument, bench, give_up_s=time.monotonic() + PATIENCE_S)
        if not bench.fired:
            raise NeverHappenedError(f"{fault.kind} never happened to {row.model}")
    return outcome


def _bring_to_rest(row: Row, instrument: Any, bench: SimulatedBench, give_up_s: float) -> None:
    """What a campaign does after an error, through the same driver: once the fault is over, it must be possible."""
    try:
        with instrument:
            if row.kind == "chamber":
                instrument.go_to(23.0)
            elif row.kind == "rate_table" and instrument.state() not in (TableState.DISABLED, TableState.FAULT):
                instrument.stop()
            elif row.kind == "digitizer":
                instrument.stop_stream()
    except LinkError:
        if time.monotonic() > give_up_s:
            raise
        _bring_to_rest(row, instrument, bench, give_up_s)
    bench.clock.sleep(60.0)
    if row.kind == "rate_table" and abs(bench.world.table.motion().rate_dps) > 0.01:
        raise WrongError(f"{row.model}: the table still turns")


@contextmanager
def _repetitions() -> Iterator[list[str]]:
    told: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: told.append(record.getMessage())  # type: ignore[method-assign]
    logger.addHandler(handler)
    try:
        yield told
    finally:
        logger.removeHandler(handler)
