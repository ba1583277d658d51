"""A simulated device's serial line: a pseudo-terminal if the system has them, otherwise serial over TCP.

The module also contains a rate table's server, which serves a controller whose interlock can be opened.
"""

from __future__ import annotations

import os
import select
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from threading import Thread
from typing import Protocol

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.lines import LineCutter, encode_line
from benchctl_instruments.simulated.faults.link_faults import Conversation, FaultyConversation, LinkFaults
from benchctl_instruments.simulated.faults.wires import Lines, Wire
from benchctl_instruments.simulated.tcp_server import Startable, TcpServer

BITS_PER_BYTE = 10  # 8N1: start bit, eight data bits, stop bit
MOST_BYTES = 4096
PACED_PIECE_S = 0.005


def open_pty() -> tuple[int, int, str]:
    """Return master and slave of a new pseudo-terminal that changes no byte, and the slave's name.

    The slave stays open: otherwise the master would get an I/O error each time the client closes the port.
    """
    import tty  # not on Windows

    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    return master, slave, os.ttyname(slave)


class PtyLine(Startable):
    """One pseudo-terminal from `start()` to `stop()`; `port` is its name and `address` "serial://PORT".

    A pseudo-terminal has no speed. With `pace_baud` the device receives a request only when its last byte would have
    arrived, and the reply is sent in pieces at that speed. Bytes that no client reads are dropped once the terminal's
    buffer is full, as by a real receiver, and counted in `dropped_bytes`. `faults`, to be set before the start,
    apply to the requests; a fault that ends a connection only silences the line.
    """

    def __init__(self, device: Conversation, *, pace_baud: int | None) -> None:
        self._device = device
        self._byte_s = BITS_PER_BYTE / pace_baud if pace_baud else 0.0
        self._thread: Thread | None = None
        self.faults: LinkFaults | None = None
        self.port = ""
        self.dropped_bytes = 0

    @property
    def address(self) -> str:
        """Address of a client's end."""
        return f"serial://{self.port}"

    def start(self) -> None:
        """Create the terminal and serve it in a new thread."""
        self._master, self._slave, self.port = open_pty()
        self._awake, self._wake = os.pipe()
        self._thread = Thread(target=self._serve, name=f"line {self.port}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread and remove the terminal; safe to call twice."""
        if self._thread is None:
            return
        os.write(self._wake, b"!")
        self._thread.join()
        self._thread = None
        for fd in (self._master, self._slave, self._awake, self._wake):
            os.close(fd)

    def _serve(self) -> None:
        faulty = None if self.faults is None else self.faults.on(self._device)
        while True:
            ready, _, _ = select.select([self._master, self._awake], [], [])
            if self._awake in ready:
                return
            data = os.read(self._master, MOST_BYTES)
            self._let_pass(data)
            if faulty is None:
                self._send(self._device.feed(data))
            else:
                self._send_with_faults(faulty, data)

    def _send_with_faults(self, faulty: FaultyConversation, data: bytes) -> None:
        for piece in faulty.answer(data).pieces:
            time.sleep(piece.after_s)
            self._send(piece.data)

    def _send(self, data: bytes) -> None:
        size = max(1, int(PACED_PIECE_S / self._byte_s)) if self._byte_s else MOST_BYTES
        for first in range(0, len(data), size):
            piece = data[first : first + size]
            self._let_pass(piece)
            try:
                self.dropped_bytes += len(piece) - os.write(self._master, piece)
            except BlockingIOError:
                self.dropped_bytes += len(piece)

    def _let_pass(self, data: bytes) -> None:
        if self._byte_s:  # sleeping for no time still takes some
            time.sleep(len(data) * self._byte_s)


class Line(Startable, Protocol):
    """A line that carries an instrument's bytes."""

    faults: LinkFaults | None

    @property
    def address(self) -> str:
        """Its address."""


class Served(Startable):
    """An instrument served on a line, from `start()` to `stop()`, or in a `with`."""

    def __init__(self, line: Line) -> None:
        self._line = line

    @property
    def address(self) -> str:
        """Its address; that of a pseudo-terminal is known after `start`."""
        return self._line.address

    @property
    def faults(self) -> LinkFaults | None:
        """The faults of the requests; to be set before the start."""
        return self._line.faults

    @faults.setter
    def faults(self, faults: LinkFaults | None) -> None:
        self._line.faults = faults

    def start(self) -> None:
        """Serve; when it returns, a client can connect."""
        self._line.start()

    def stop(self) -> None:
        """Stop serving; safe to call twice. The machine behind the line continues."""
        self._line.stop()

    def cut_connections(self) -> None:
        """Close all connections, as by a pulled cable; a pseudo-terminal has none."""
        if isinstance(self._line, TcpServer):
            self._line.cut_connections()


class LineConversation:
    """One connection of a line-based instrument.

    Parameters
    ----------
    answer
        Returns the answer to a line. A line that is too long is answered like any invalid one.
    lines
        Splits the received bytes into lines.
    """

    def __init__(self, answer: Callable[[str], bytes], lines: LineCutter) -> None:
        self._answer = answer
        self._lines = lines

    def feed(self, data: bytes) -> bytes:
        """Add received bytes and return the answers to complete lines."""
        try:
            lines = self._lines.feed(data)
        except InstrumentError:
            lines = ["(a line that was too long)"]
        return b"".join(map(self._answer, lines))


def line_conversation(
    execute: Callable[[str], str | None], *, encoding: str = "ascii", end: bytes = b"\r\n"
) -> LineConversation:
    """Return a connection whose lines end with CR, LF or both, as terminals send them.

    An answer may have several lines, each with `end`; None is no answer.
    """

    def answer(line: str) -> bytes:
        return b"".join(encode_line(text, end, encoding=encoding) for text in (execute(line) or "").splitlines())

    return LineConversation(answer, LineCutter(None, encoding=encoding))


class SerialLine(Served):
    """A line with a device, from `start()` to `stop()`, or in a `with`; the client need not know its kind.

    `address` is "serial:///dev/pts/4?baud=19200" or "socket://127.0.0.1:PORT", known after `start`.

    Parameters
    ----------
    device
        Creates the device's end of a connection: once for a pseudo-terminal, once for each connection over TCP.
    baud
        The speed that the address names; a pseudo-terminal accepts any and uses none.
    pace_baud
        Simulated speed of the line; None: no delay.
    over_tcp
        Serial over TCP even if pseudo-terminals exist.
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
        """The address for a driver."""
        if isinstance(self._line, TcpServer):
            return self._line.address.replace("tcp://", "socket://")
        return f"{self._line.address}?baud={self._baud}"


class LineServer(Served):
    """A controller that answers lines, on one kind of line; its models are subclasses, and say which refusal they send.

    Parameters
    ----------
    execute
        Executes one line and returns its answer, see `line_conversation`.
    over_tcp
        Serve over TCP, to several clients at once; otherwise on a serial line at 9600 baud, see `SerialLine`.
    encoding
        Of the lines.
    end
        The end of each answer.
    pace_baud
        Simulated speed of the line; None: no delay.
    """

    wire: Wire = Lines()

    def __init__(
        self,
        execute: Callable[[str], str | None],
        *,
        over_tcp: bool,
        encoding: str = "ascii",
        end: bytes = b"\r\n",
        pace_baud: int | None = None,
    ) -> None:
        connect = partial(line_conversation, execute, encoding=encoding, end=end)
        super().__init__(
            TcpServer(connect, pace_baud=pace_baud) if over_tcp else SerialLine(connect, baud=9600, pace_baud=pace_baud)
        )


class TableController(Protocol):
    """The states of a simulated controller that can be changed from outside.

    `closing` is set while it is not served: answers then do not wait for a motion.
    """

    closing: threading.Event

    def open_interlock(self) -> None:
        """Press the emergency stop."""

    def close_interlock(self) -> None:
        """Release the emergency stop."""

    def trip(self) -> None:
        """Cause a following error."""

    def restart(self) -> None:
        """Restart, as after a power failure."""


class TableServer(Served):
    """A controller on a line, from `start()` to `stop()`, or in a `with`.

    Parameters
    ----------
    controller
        The controller. Its methods for manual actions are also those of the server.
    line
        The line that serves it.
    """

    def __init__(self, controller: TableController, line: Line) -> None:
        super().__init__(line)
        self._controller = controller
        self.open_interlock, self.close_interlock = controller.open_interlock, controller.close_interlock
        self.trip, self.restart = controller.trip, controller.restart

    def start(self) -> None:
        """Serve; when it returns, a client can connect."""
        self._controller.closing.clear()
        super().start()

    def stop(self) -> None:
        """Stop serving; the table continues its motion."""
        self._controller.closing.set()
        super().stop()
