"""What every simulated rate table on a wire does alike: it serves, and its controller can be meddled with by hand."""

from __future__ import annotations

import threading
from typing import Protocol

from benchctl_instruments.simulated.serial_line import Line, Served


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


class TableServer(Served):
    """A controller on a line, from `start()` to `stop()`, or in a `with`.

    Parameters
    ----------
    controller
        What answers there; its own methods say what a hand at the bench leads to.
    line
        What serves it.
    """

    def __init__(self, controller: TableController, line: Line) -> None:
        super().__init__(line)
        self._controller = controller

    def start(self) -> None:
        """Serve; when it returns, a client can connect."""
        self._controller.closing.clear()
        super().start()

    def stop(self) -> None:
        """Stop serving; the table goes on with what it was doing."""
        self._controller.closing.set()
        super().stop()

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
