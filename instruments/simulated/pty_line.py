"""A serial line made of a pseudo-terminal: a client opens it like any serial port, a simulated device is at its end."""

from __future__ import annotations

import os
import select
import time
import tty
from threading import Thread

from benchctl_instruments.simulated.faults.link_faults import FaultyConversation, LinkFaults
from benchctl_instruments.simulated.tcp_server import Conversation

BITS_PER_BYTE = 10  # 8N1: start bit, eight data bits, stop bit
MOST_BYTES = 4096
PACED_PIECE_S = 0.005


class PtyLine:
    """One pseudo-terminal from `start()` to `stop()`, by then `port` is its name and `address` "serial://PORT".

    A pseudo-terminal has no speed. With `pace_baud` the device sees a request only when its last byte would have
    arrived, and the reply leaves in pieces at that speed. Bytes that no client takes are dropped once the terminal's
    buffer is full, as a real receiver would, and counted in `dropped_bytes`. `faults`, to be set before the start,
    befall the requests; where they end a connection, a line has none to end and is only silent.
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
        """Of a client's end."""
        return f"serial://{self.port}"

    def start(self) -> None:
        """Make the terminal and serve it from a thread of its own."""
        # The slave stays open here: without it the master would see an I/O error each time the client closes the port.
        self._master, self._slave = os.openpty()
        self._awake, self._wake = os.pipe()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
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
