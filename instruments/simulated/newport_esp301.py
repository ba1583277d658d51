"""A simulated ESP301 at the end of a serial line. It shares only the protocol with the driver."""

from __future__ import annotations

from collections.abc import Callable

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.esp301 import ANSWER_END, SENT_END
from benchctl_instruments.protocols.lines import LineCutter
from benchctl_instruments.simulated.faults.wires import Lines, Wire
from benchctl_instruments.simulated.machines import TableMachine
from benchctl_instruments.simulated.newport_esp301_controller import Esp301Controller
from benchctl_instruments.simulated.serial_line import SerialLine
from benchctl_instruments.simulated.table_server import TableServer


class SimulatedEsp301(TableServer):
    """Serves a simulated table, axis 1, on a pseudo-terminal, or as serial over TCP.

    Parameters
    ----------
    table
        The axis; its limits at this moment are the most that the controller takes.
    pace_baud, over_tcp
        As of `SerialLine`.
    """

    wire: Wire = Lines()  # what it refuses it does not answer

    def __init__(self, table: TableMachine, *, pace_baud: int | None = None, over_tcp: bool = False) -> None:
        controller = Esp301Controller(table)
        line = SerialLine(lambda: _Conversation(controller.execute), pace_baud=pace_baud, over_tcp=over_tcp)
        super().__init__(controller, line)


class _Conversation:
    """One end of the line: lines in, the answers of their queries out."""

    def __init__(self, execute: Callable[[str], list[str]]) -> None:
        self._execute = execute
        self._lines = LineCutter(SENT_END)

    def feed(self, data: bytes) -> bytes:
        try:
            lines = self._lines.feed(data)
        except InstrumentError:  # more than a line can hold: the real one would not answer either
            return b""
        return b"".join(answer.encode("ascii") + ANSWER_END for line in lines for answer in self._execute(line))


Twin = SimulatedEsp301
