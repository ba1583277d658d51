"""The table of drivers and faults, made by running every cell: `python -m tests.instruments.faults.table`."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.instruments.faults import kinds
from tests.instruments.faults.cells import IMPOSSIBLE, RECOVERED, Outcome, befallen
from tests.instruments.faults.rows import GYROS, ROWS, Row
from tests.instruments.faults.runs import run_with


def link_table() -> Iterator[str]:
    """Faults of the link, which befall a question and a command; where both end alike it is said once."""
    yield from _head("fault of the link", ROWS)
    for fault, make in kinds.LINK.items():
        cells = []
        for row in ROWS:
            came = [befallen(row, make(on=row.kind, pattern=pattern, nth=1)) for pattern in (row.asks, row.tells)]
            cells.append(" / ".join(dict.fromkeys(map(_words, came))))
        yield _line(fault, cells)


def machine_table() -> Iterator[str]:
    """Faults of the machine and of the stream, which befall a short campaign."""
    yield from _head("fault of the instrument", ROWS)
    for fault in dict.fromkeys(fault for faults in kinds.MACHINE.values() for fault in faults):
        yield _line(fault, [_run_words(row, fault, row.kind) for row in ROWS])
    for fault in kinds.STREAM:
        yield _line(fault, [_run_words(row, fault, f"{row.kind}_stream") for row in ROWS])


def frame_table() -> Iterator[str]:
    """Faults of a digital gyro's line, which befall a short campaign."""
    yield from _head("fault of the gyro's line", GYROS)
    for fault, make in kinds.FRAMES.items():
        cells = []
        for row in GYROS:
            with tempfile.TemporaryDirectory() as folder:
                cells.append(_words(run_with(row, make(on="gyro"), Path(folder) / "c").outcome))
        yield _line(fault, cells)


def _run_words(row: Row, fault: str, on: str) -> str:
    faults = kinds.STREAM if on.endswith("_stream") else kinds.MACHINE[row.kind]
    if fault not in faults or row.is_slow or (faults is kinds.STREAM and not row.has_packets):
        return "-"
    with tempfile.TemporaryDirectory() as folder:
        return _words(run_with(row, faults[fault](on=on), Path(folder) / "c").outcome)


def _words(outcome: Outcome) -> str:
    if outcome.what == IMPOSSIBLE:
        return "-"
    if outcome.what == RECOVERED and outcome.repeated:
        return "recovered, asked again"
    return outcome.what


def _head(first: str, rows: Sequence[Row]) -> Iterator[str]:
    yield _line(first, [row.model for row in rows])
    yield "|---" * (1 + len(rows)) + "|"


def _line(first: str, cells: Sequence[str]) -> str:
    return f"| {first} | {' | '.join(cells)} |"


INTRO = """# What becomes of every fault with every driver

Made by `python -m tests.instruments.faults.table`, every cell by running it: over real wires, against the simulated
instrument. "Recovered": nothing is lost and nothing wrong was taken, with the question asked again where it says so.
"Stopped": the run, or the command, ends with a clear reason, and the bench is brought to rest. Two outcomes: at a
question / at a command. "-": the protocol, or this kind of instrument, has nothing that could go wrong so.
"""


def main() -> None:
    """Print all tables as Markdown."""
    sys.stdout.write(f"{INTRO}\n")
    for table in (link_table(), machine_table(), frame_table()):
        for line in table:
            sys.stdout.write(f"{line}\n")
        sys.stdout.write("\n")


if __name__ == "__main__":
    main()
