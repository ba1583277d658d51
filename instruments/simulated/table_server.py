"""What every simulated rate table on a wire does alike: it serves, and its controller can be meddled with by hand."""

from __future__ import annotations

import threading
from typing import Protocol, Self

from benchctl_instruments.simulated.faults.link_faults import LinkFaults
from benchctl_instruments.simulated.serial_line import SerialLine
from benchctl_instruments.simulated.tcp_server import TcpServer


class TableController(Protocol):
    """The states of a simulated controller, as far as a hand at the bench can reach them.

    `closing` is set while nothing serves it: no answer waits for a motion then.
    """

    closing: threading.Event

    def open_interlock(self) -> None:
        """Press the emergency stop."""

    def close_interlock(self) -> None:
        """Release the emergency stop."""

    def trip(self) -> None:
        """Let the axis fail to follow."""

    def restart(self) -> None:
        """Start anew, as after a power failure."""


class TableServer:
    """A controller on a line, from `start()` to `stop()`, or in a `with`.

    Parameters
    ----------
    controller
        What answers there; its own methods say what a hand at the bench leads to.
    line
        What serves it.
    """

    def __init__(self, controller: TableController, line: TcpServer | SerialLine) -> None:
        self._controller = controller
        self._line = line

    @property
    def address(self) -> str:
        """Where it answers; that of a serial line is known once it is started."""
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
        self._controller.closing.clear()
        self._line.start()

    def stop(self) -> None:
        """Stop serving; the table goes on with what it was doing."""
        self._controller.closing.set()
        self._line.stop()

    def open_interlock(self) -> None:
        """Open the interlock by hand, as an emergency stop does."""
        self._controller.open_interlock()

    def close_interlock(self) -> None:
        """Close the interlock by hand; what it led to stays until the controller is told otherwise."""
        self._controller.close_interlock()

    def trip(self) -> None:
        """A following error."""
        self._controller.trip()

    def restart(self) -> None:
        """Start anew, as after a power failure."""
        self._controller.restart()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()
