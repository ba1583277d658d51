"""A simulated ESP301 at the end of a serial line. It shares only the protocol with the driver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

from instruments.errors import InstrumentError
from instruments.protocols.esp301 import ANSWER_END, SENT_END
from instruments.protocols.lines import LineCutter
from instruments.simulated.faults.link_faults import LinkFaults
from instruments.simulated.faults.wires import Lines, Wire
from instruments.simulated.machines import TableMachine
from instruments.simulated.newport_esp301_controller import Esp301Controller
from instruments.simulated.serial_line import SerialLine


class SimulatedEsp301:
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
        self._controller = Esp301Controller(table)
        self._line = SerialLine(lambda: _Conversation(self._controller.execute), pace_baud=pace_baud, over_tcp=over_tcp)

    @property
    def address(self) -> str:
        """Where it answers, known once it is started."""
        return self._line.address

    @property
    def faults(self) -> LinkFaults | None:
        """What befalls the requests; to be set before the start."""
        return self._line.faults

    @faults.setter
    def faults(self, faults: LinkFaults | None) -> None:
        self._line.faults = faults

    def start(self) -> None:
        """Serve; when it returns, a client can connect."""
        self._line.start()

    def stop(self) -> None:
        """Stop serving; the table goes on with what it was doing."""
        self._line.stop()

    def open_interlock(self) -> None:
        """Press the emergency stop: the motor is off until it is released and switched on again."""
        self._controller.open_interlock()

    def close_interlock(self) -> None:
        """Release the emergency stop; the motor stays off."""
        self._controller.close_interlock()

    def trip(self) -> None:
        """Switch the motor off by a following error."""
        self._controller.trip()

    def restart(self) -> None:
        """Start anew, as after a power failure."""
        self._controller.restart()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()


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
