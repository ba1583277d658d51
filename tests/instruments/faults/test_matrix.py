"""Every driver in every fault, over real sockets and pseudo-terminals: `python -m tests.instruments.faults.table`.

Recovered means: the dialogue came to its end with the results it has without the fault, and the instrument is where it
was sent. Stopped means: one line says which instrument did what, and the same driver brought it to rest afterwards.
"""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

from benchctl_instruments.catalog import MANUAL, models
from benchctl_instruments.simulated.faults.bench import AnyLinkFault, AnyMachineFault, AnyStreamFault
from benchctl_instruments.simulated.faults.schedule import FaultTable
from benchctl_instruments.simulated.faults.stream_faults import FrameFault
from tests.instruments.faults import kinds, outcomes
from tests.instruments.faults.cells import IMPOSSIBLE, STOPPED, Outcome, befallen
from tests.instruments.faults.rows import GYROS, ROWS, Row
from tests.instruments.faults.runs import run_with

QUICK = {"chamber": "watlow_f4", "rate_table": "acutrol3000", "digitizer": "labjack_t7", "gyro": str(GYROS[0])}
"""The driver of each kind that the quick tests try in every fault; the others are tried by the slow ones."""


def _marks(row: Row) -> list[pytest.MarkDecorator]:
    return [] if QUICK[row.kind] == str(row) else [pytest.mark.slow]


LINK_CELLS = [pytest.param(row, fault, id=f"{row}-{fault}", marks=_marks(row)) for row in ROWS for fault in kinds.LINK]
MACHINE_CELLS = [
    pytest.param(row, fault, id=f"{row}-{fault}", marks=_marks(row))
    for row in ROWS
    if not row.is_slow
    for fault in kinds.MACHINE[row.kind]
]
STREAM_CELLS = [
    pytest.param(row, fault, id=f"{row}-{fault}") for row in ROWS if row.has_packets for fault in kinds.STREAM
]


@pytest.mark.parametrize(("row", "fault"), LINK_CELLS)
def test_a_fault_of_the_link_ends_as_the_table_says(row: Row, fault: str) -> None:
    came = [befallen(row, kinds.LINK[fault](on=row.kind, pattern=pattern, nth=1)) for pattern in (row.asks, row.tells)]
    assert tuple(outcome.what for outcome in came) == outcomes.of_link(row.model, fault), came
    for outcome in came:
        _say_why(row, outcome)


@pytest.mark.parametrize(("row", "fault"), MACHINE_CELLS)
def test_a_fault_of_the_machine_ends_a_run_as_the_table_says(row: Row, fault: str, tmp_path: Path) -> None:
    came = run_with(row, kinds.MACHINE[row.kind][fault](on=row.kind), tmp_path / "c")
    assert came.outcome.what == outcomes.MACHINE[fault], came
    assert came.events[-2:] == ("safe", "finish")
    assert "\n" not in came.outcome.why


@pytest.mark.parametrize(("row", "fault"), STREAM_CELLS)
def test_a_fault_of_the_stream_ends_a_run_as_the_table_says(row: Row, fault: str, tmp_path: Path) -> None:
    came = run_with(row, kinds.STREAM[fault](on=f"{row.kind}_stream"), tmp_path / "c")
    assert came.outcome.what == outcomes.STREAM[fault], came
    assert ("gap" in came.events) == bool(came.outcome.lost)
    assert ("recovered" in came.events) == (fault in ("stream cut", "stream junk", "stream ends"))


@pytest.mark.parametrize("row", [pytest.param(row, id=str(row), marks=_marks(row)) for row in GYROS])
@pytest.mark.parametrize("fault", kinds.FRAMES)
def test_a_fault_of_a_gyros_line_ends_a_run_as_the_table_says(row: Row, fault: str, tmp_path: Path) -> None:
    came = run_with(row, kinds.FRAMES[fault](on="gyro"), tmp_path / "c")
    assert came.outcome.what == outcomes.FRAMES[fault], came
    assert came.events[-2:] == ("safe", "finish")
    assert ("frames_lost" in came.events) == (came.outcome.lost == 1)
    assert ("recovered" in came.events) == (fault not in ("frame lost", "frames end"))
    assert came.outcome.why.startswith("gyro: no news") == (fault == "frames end")


def test_every_driver_stands_in_the_table() -> None:
    for kind in ("rate_table", "chamber", "digitizer", "gyro"):
        wired = set(models(kind)) - {MANUAL}
        assert {row.model for row in (*ROWS, *GYROS) if row.kind == kind} == wired, "a driver without a row in rows.py"


def test_no_cell_is_empty() -> None:
    assert set(outcomes.LINK) == set(kinds.LINK)
    assert set(outcomes.MACHINE) == {fault for faults in kinds.MACHINE.values() for fault in faults}
    assert set(outcomes.STREAM) == set(kinds.STREAM)
    assert set(outcomes.FRAMES) == set(kinds.FRAMES)
    assert set(outcomes.LINK_OF) <= {row.model for row in ROWS}


def test_every_kind_of_fault_that_can_be_scheduled_stands_in_the_table() -> None:
    def names(kinds_of_fault: tuple[type[FaultTable], ...]) -> set[str]:
        return {
            name
            for kind in kinds_of_fault
            for name in kind.model_fields["kind"].annotation.__args__  # type: ignore[attr-defined]
        }

    made = [make(on="chamber").kind for make in kinds.LINK.values()]
    made += [make(on=machine).kind for machine, faults in kinds.MACHINE.items() for make in faults.values()]
    made += [make(on="digitizer_stream").kind for make in kinds.STREAM.values()]
    made += [make(on="gyro").kind for make in kinds.FRAMES.values()]
    assert set(made) == names(get_args(AnyLinkFault | AnyMachineFault | AnyStreamFault | FrameFault))


def _say_why(row: Row, outcome: Outcome) -> None:
    assert "\n" not in outcome.why
    if outcome.what == STOPPED:
        assert row.kind in outcome.why or "://" in outcome.why
    elif outcome.what == IMPOSSIBLE:
        assert "faults:" in outcome.why
