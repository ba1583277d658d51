"""A line of a simulated device that sends spontaneously and accepts commands: a pseudo-terminal, or TCP."""

from __future__ import annotations

import os
import select
import sys
import threading
import time
from collections.abc import Callable
from typing import Protocol

from benchctl_instruments.simulated.serial_line import MOST_BYTES, open_pty
from benchctl_instruments.simulated.tcp_server import LatestClient, Startable

PIECE_S = 0.004
"""Wall time between two checks for due data: as coarse as a good serial converter delivers them."""

PATIENCE_S = 0.02
"""Wall time between two checks for data from the client."""

FULL_LINE_S = 0.5
"""Wall time for which a full line may delay the device: on a busy machine a listening client may be slow."""


class Talker(Protocol):
    """A device that sends spontaneously; the line calls it from one thread."""

    def feed(self, data: bytes) -> bytes:
        """Process received bytes, and return the answers to complete commands."""

    def due(self) -> bytes:
        """Return the bytes that are due and not sent yet, or b""."""

    def lose(self) -> None:
        """Discard all other due bytes, since the last ones were not accepted."""

    def wait(self, timeout_s: float) -> bool:
        """Wait until bytes are due, at most `timeout_s` of wall time; return False at once if none will ever be."""


class PushLine(Startable):
    """A device's line from `start()` to `stop()`, or in a `with`; a driver uses its `address`.

    A client that does not read delays the device for 0.5 s; then all due bytes are dropped, as by an overrun receiver.
    TCP has one client, the latest one; without a client, all bytes are dropped.

    Parameters
    ----------
    device
        The device that sends.
    baud
        The speed that the address names; the line itself has none.
    over_tcp
        Use TCP even if pseudo-terminals exist.

    Attributes
    ----------
    dropped_bytes
        Number of bytes that no client accepted.
    disturb
        Function applied to the bytes sent to the client; may be assigned.
    """

    def __init__(self, device: Talker, *, baud: int, over_tcp: bool) -> None:
        self.dropped_bytes = 0
        self.disturb: Callable[[bytes], bytes] = lambda data: data
        self._device = device
        self._baud = baud
        self._end: _TcpEnd | _PtyEnd = _TcpEnd() if over_tcp or sys.platform == "win32" else _PtyEnd()
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()

    @property
    def address(self) -> str:
        """`serial://DEVICE?baud=N` or `socket://HOST:PORT`, known after `start`."""
        return self._end.address(self._baud)

    def start(self) -> None:
        """Open the line; when it returns, a client can connect."""
        if self._thread is not None:
            return
        self._end.open()
        self._stopping.clear()
        self._thread = threading.Thread(target=self._serve, name=f"push {self.address}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close the line and join the thread; safe to call twice."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self._end.close()

    def _serve(self) -> None:
        while not self._stopping.is_set():
            self._hear(self._end.receive(0.0))
            if self._send_due():
                time.sleep(PIECE_S)
            elif not self._device.wait(PATIENCE_S):
                self._hear(self._end.receive(PATIENCE_S))

    def _hear(self, received: bytes) -> None:
        """Answer the client; bytes that were due before its command are sent before the answer."""
        give_up_s = time.monotonic() + FULL_LINE_S  # a limit, since more bytes may become due all the time
        while received and time.monotonic() < give_up_s and self._send_due():
            pass
        self._send(self._device.feed(received))

    def _send_due(self) -> bool:
        """Send due bytes, at most a batch; return whether there were any."""
        data = self._device.due()
        if data and not self._send(data):
            self._device.lose()
        return bool(data)

    def _send(self, data: bytes) -> bool:
        """Return whether the client accepted all bytes."""
        left = memoryview(self.disturb(data)) if data else memoryview(b"")
        give_up_s = time.monotonic() + FULL_LINE_S
        while left:
            sent = self._end.send(left[:MOST_BYTES], max(0.0, give_up_s - time.monotonic()))
            if not sent:
                self.dropped_bytes += len(left)
                return False
            left = left[sent:]
            give_up_s = time.monotonic() + FULL_LINE_S
        return True


class _PtyEnd:
    """The master's side of a pseudo-terminal."""

    def __init__(self) -> None:
        self._port = ""

    def address(self, baud: int) -> str:
        return f"serial://{self._port}?baud={baud}"

    def open(self) -> None:
        self._master, self._slave, self._port = open_pty()

    def close(self) -> None:
        os.close(self._master)
        os.close(self._slave)

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes from the client, b"" if none arrive in time."""
        ready, _, _ = select.select([self._master], [], [], timeout_s)
        return os.read(self._master, MOST_BYTES) if ready else b""

    def send(self, data: memoryview, timeout_s: float) -> int:
        """Return the number of bytes that the line accepted in time."""
        _, ready, _ = select.select([], [self._master], [], timeout_s)
        if not ready:
            return 0
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0


class _TcpEnd:
    """A listener and its latest client."""

    def __init__(self) -> None:
        self._latest = LatestClient()
        self.open, self.close = self._latest.open, self._latest.close

    def address(self, baud: int) -> str:
        return self._latest.address.replace("tcp://", "socket://")

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes from the client, b"" if none arrive in time or another client connects."""
        if self._latest.accepts(timeout_s, reading=True) or self._latest.client is None:
            return b""
        try:
            data = self._latest.client.recv(MOST_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._latest.drop()
        return data

    def send(self, data: memoryview, timeout_s: float) -> int:
        """Return the number of bytes that the client accepted in time."""
        if self._latest.client is None:
            return 0
        _, ready, _ = select.select([], [self._latest.client], [], timeout_s)
        return self._latest.send(data) if ready else 0
