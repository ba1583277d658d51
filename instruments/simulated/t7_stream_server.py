"""The second socket of a simulated T7, on which it sends its stream by itself to whoever is connected."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time

from benchctl_instruments.simulated.faults.stream_faults import (
    JUNK,
    Overrun,
    StreamCut,
    StreamEnds,
    StreamFault,
    StreamFaults,
    StreamGap,
    StreamJunk,
    StreamStalls,
)
from benchctl_instruments.simulated.listening import address_of, listen
from benchctl_instruments.simulated.machines import AnalogInputs
from benchctl_instruments.simulated.t7_stream_buffer import StreamBuffer

SEND_BUFFER_BYTES = 1 << 16  # small, as in the instrument: a client that does not read is noticed
MOST_AHEAD = 256  # packets that are asked about, and sampled, at once
PATIENCE_S = 0.02  # wall time between two looks at what else might have changed


class T7StreamServer:
    """Sends the packets of one stream after the other to the client that connected last.

    While no stream runs it only waits, so that bench time may jump at no cost. What falls due in one jump counts as on
    its way to the client; only what falls due while the wire takes nothing fills the instrument's buffer. A new client
    gets whole packets. `faults` befall the packets of streams that begin from now on.
    """

    def __init__(self, inputs: AnalogInputs, *, host: str, port: int) -> None:
        self.faults: StreamFaults | None = None
        self._inputs = inputs
        self._where = (host, port)
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._stopping = False
        self._changed = threading.Condition()
        self._stream: StreamBuffer | None = None

    @property
    def address(self) -> str:
        """`tcp://HOST:PORT`, with the port that was really taken once it runs."""
        return address_of(self._where)

    def start(self) -> None:
        """Listen; when it returns, a client can connect."""
        if self._listener is not None:
            return
        self._listener, self._where = listen(self._where)
        self._stopping = False
        self._thread = threading.Thread(
            target=self._serve, args=(self._listener,), name=f"stream {self.address}", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """End the stream, close everything and join the thread; safe to call twice."""
        with self._changed:
            self._stopping, self._stream = True, None
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()
        self._drop_client()
        if self._listener is not None:
            self._listener.close()
        self._listener = self._thread = None

    @property
    def running(self) -> bool:
        """Whether a stream runs."""
        return self._stream is not None

    def begin(self, stream: StreamBuffer) -> None:
        """Send this stream from now on."""
        with self._changed:
            self._inputs.hold_history(stream.next_scan_s)
            self._stream = stream
            self._changed.notify_all()

    def end(self) -> None:
        """End the stream once every scan that is due was taken.

        After this has returned nothing is sampled and nothing sent: a client of the next stream gets only that one.
        """
        with self._changed:
            if self._stream is not None:
                self._stream.finish(self._inputs.now())
            self._stream = None
            self._inputs.hold_history(None)

    def _serve(self, listener: socket.socket) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopping or self._stream is not None)
                stream = self._stream
            if stream is None:
                return
            if self.faults is None:
                self._run(stream, listener)
            else:
                self._run_with_faults(stream, listener, self.faults)

    def _run(self, stream: StreamBuffer, listener: socket.socket) -> None:
        while self._stream is stream:
            now_s = self._inputs.now()
            packets = self._packets(stream, now_s)
            if packets:
                self._send(stream, packets, stream.due(now_s), listener)
            if stream.over:
                self._end_if(stream)
            elif stream.next_packet_s > self._inputs.now():
                self._inputs.wait_until(stream.next_packet_s, PATIENCE_S)

    def _run_with_faults(self, stream: StreamBuffer, listener: socket.socket, faults: StreamFaults) -> None:
        """As `_run`; a packet that a fault befalls goes by itself, behind the sound ones before it."""
        sound, fault, lost = 0, None, 0
        while self._stream is stream:
            now_s = self._inputs.now()
            while fault is None and sound < MOST_AHEAD and stream.full_s(sound) <= now_s:
                fault = faults.due(stream.next_packet + sound, stream.begins_s(sound))
                sound += fault is None
            if sound or isinstance(fault, Overrun):
                if not sound and isinstance(fault, Overrun):
                    stream.overrun(fault.scans)
                    sound, fault = 1, None
                packets = self._packets(stream, now_s, most=sound)
                made = len(packets) // stream.packet_bytes
                kept = packets[min(lost, made) * stream.packet_bytes :]
                sound, lost = sound - made, max(0, lost - made)
                if kept:
                    self._send(stream, kept, stream.due(now_s), listener)
            elif fault is not None:
                packet = self._packets(stream, now_s, most=1)
                if isinstance(fault, StreamGap):
                    lost = fault.packets - 1
                else:
                    self._send_with_fault(fault, stream, packet, listener)
                fault = None
            if stream.over:
                self._end_if(stream)
            elif stream.next_packet_s > self._inputs.now():
                self._inputs.wait_until(stream.next_packet_s, PATIENCE_S)

    def _send_with_fault(
        self, fault: StreamFault, stream: StreamBuffer, packet: bytes, listener: socket.socket
    ) -> None:
        in_transit = stream.due(self._inputs.now())
        if isinstance(fault, StreamEnds):
            self._end_if(stream)
        elif isinstance(fault, StreamCut):
            self._cut(stream, packet, listener)
        else:
            if isinstance(fault, StreamStalls):
                self._stall(fault.for_s, stream, in_transit)
            junk = JUNK if isinstance(fault, StreamJunk) else b""
            self._send(stream, junk + packet, in_transit, listener)

    def _cut(self, stream: StreamBuffer, packet: bytes, listener: socket.socket) -> None:
        with self._changed:
            if self._stream is stream:
                self._accept(listener)
                self._send_some(memoryview(packet)[: len(packet) // 2])
                self._drop_client()

    def _stall(self, for_s: float, stream: StreamBuffer, in_transit: int) -> None:
        until_s = time.monotonic() + for_s
        while self._stream is stream and time.monotonic() < until_s:
            stream.fill(self._inputs.now(), in_transit)
            time.sleep(PATIENCE_S)

    def _packets(self, stream: StreamBuffer, now_s: float, *, most: int | None = None) -> bytes:
        with self._changed:
            if self._stream is not stream:
                return b""
            packets = stream.packets(now_s, most=most)
            self._inputs.hold_history(stream.next_scan_s)
            return packets

    def _end_if(self, stream: StreamBuffer) -> None:
        with self._changed:
            if self._stream is stream:
                self._stream = None
                self._inputs.hold_history(None)

    def _send(self, stream: StreamBuffer, packets: bytes, in_transit: int, listener: socket.socket) -> None:
        left, client = memoryview(packets), self._client
        while left:
            with self._changed:
                if self._stream is not stream:
                    return
                self._accept(listener)
                if self._client is not client:  # the new one gets the packet from its beginning
                    sent = len(packets) - len(left)
                    left, client = memoryview(packets)[sent - sent % stream.packet_bytes :], self._client
                count = self._send_some(left)
            left = left[count:]
            if not count:
                stream.fill(self._inputs.now(), in_transit)
                select.select([listener], [self._client] if self._client else [], [], PATIENCE_S)

    def _accept(self, listener: socket.socket) -> None:
        """Take the newest of those who have connected since the last look."""
        while select.select([listener], [], [], 0)[0]:
            with contextlib.suppress(OSError):  # it is gone already
                self._take(listener.accept()[0])

    def _take(self, client: socket.socket) -> None:
        client.setblocking(False)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._drop_client()
        self._client = client

    def _send_some(self, data: memoryview) -> int:
        if self._client is None:
            return 0
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:  # it went away
            self._drop_client()
            return 0

    def _drop_client(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
