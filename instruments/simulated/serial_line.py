"""A simulated device's serial line: a pseudo-terminal where the system has them, otherwise serial over TCP."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Protocol, Self

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.lines import LineCutter
from benchctl_instruments.simulated.faults.link_faults import LinkFaults
from benchctl_instruments.simulated.tcp_server import Conversation, TcpServer

if sys.platform != "win32":
    from benchctl_instruments.simulated.pty_line import PtyLine


class Line(Protocol):
    """What carries an instrument's bytes."""

    faults: LinkFaults | None

    @property
    def address(self) -> str:
        """Where it is."""

    def start(self) -> None:
        """Serve."""

    def stop(self) -> None:
        """Close everything."""


class Served:
    """What a line serves, from `start()` to `stop()`, or in a `with`."""

    def __init__(self, line: Line) -> None:
        self._line = line

    @property
    def address(self) -> str:
        """Where it answers; that of a pseudo-terminal is known once it is started."""
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
        """Stop serving; safe to call twice. What is behind the line goes on with what it was doing."""
        self._line.stop()

    def cut_connections(self) -> None:
        """Pull the cable for a moment; a pseudo-terminal has none."""
        if isinstance(self._line, TcpServer):
            self._line.cut_connections()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()


class LineConversation:
    """One connection of an instrument that speaks in lines.

    Parameters
    ----------
    answer
        What goes back for a line. One that is too long is answered as any other that cannot be understood.
    lines
        Cuts what comes into lines.
    """

    def __init__(self, answer: Callable[[str], bytes], lines: LineCutter) -> None:
        self._answer = answer
        self._lines = lines

    def feed(self, data: bytes) -> bytes:
        """Take what arrived, and answer the lines that are complete."""
        try:
            lines = self._lines.feed(data)
        except InstrumentError:
            lines = ["(a line that was too long)"]
        return b"".join(map(self._answer, lines))


class SerialLine(Served):
    """A line with a device at its end, from `start()` to `stop()`, or in a `with`; the client need not know which kind.

    `address` is "serial:///dev/pts/4?baud=19200" or "socket://127.0.0.1:PORT", known once it is started.

    Parameters
    ----------
    device
        Makes the device's end of a connection: once for a pseudo-terminal, once for each connection over TCP.
    baud
        The speed that the address names; a pseudo-terminal takes any and keeps none.
    pace_baud
        Bytes move as a line at this speed would let them; None: at once.
    over_tcp
        Serial over TCP also where pseudo-terminals exist.
    """

    def __init__(
        self,
        device: Callable[[], Conversation],
        *,
        baud: int = 19200,
        pace_baud: int | None = None,
        over_tcp: bool = False,
    ) -> None:
        self._baud = baud
        if over_tcp or sys.platform == "win32":
            super().__init__(TcpServer(device, pace_baud=pace_baud))
        else:
            super().__init__(PtyLine(device(), pace_baud=pace_baud))

    @property
    def address(self) -> str:
        """What a driver is given to find the line."""
        if isinstance(self._line, TcpServer):
            return self._line.address.replace("tcp://", "socket://")
        return f"{self._line.address}?baud={self._baud}"
