"""The stream of a simulated T7: scans when they are due, packets, and the second socket that carries them.

The instrument's buffer holds the data that the wire does not take. When it is full, scans are skipped and counted; once
the wire has taken the stored data, a dummy scan marks the gap and scanning continues, as in `protocols.t7_stream`.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl_instruments.protocols.t7_stream import (
    AUTO_RECOVER_ACTIVE,
    AUTO_RECOVER_END,
    DUMMY,
    SCAN_OVERLAP,
    SKIP_OVERFLOW,
    encode_packets,
)
from benchctl_instruments.simulated.faults.schedule import PendingFaults
from benchctl_instruments.simulated.faults.stream_faults import (
    JUNK,
    Overrun,
    StreamCut,
    StreamEnds,
    StreamFault,
    StreamGap,
    StreamJunk,
    StreamStalls,
)
from benchctl_instruments.simulated.machines import AnalogInputs
from benchctl_instruments.simulated.tcp_server import LatestClient

MOST_SAMPLES_A_SECOND = 100_000
LARGEST_BATCH = 8192
ROUNDING = 1e-6  # in scan intervals: the delay after its instant at which a scan counts as past

Samples = npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamSettings:
    """The requested settings of a stream.

    `sample` maps (start, scans) to samples of `scans` scans from scan `start` on, shape (scans, `scan_length`).
    """

    first_s: float
    rate_hz: float
    scan_length: int
    samples_per_packet: int
    buffer_bytes: int
    sample: Callable[[int, int], Samples]


class StreamBuffer:
    """One stream, from its start to its end, without thread and socket.

    Attributes
    ----------
    over
        The stream ended by itself: a scan overlapped the next one, or the count of skipped scans overflowed.
    """

    def __init__(self, settings: StreamSettings) -> None:
        self.over = False
        self.packet_bytes = 16 + 2 * settings.samples_per_packet
        self._settings = settings
        self._taken = 0  # scans sampled or skipped
        self._rest: Samples = np.empty(0, np.uint16)  # samples that do not fill a packet yet
        self._transaction = 0
        self._kept_until: int | None = None  # while it recovers: the first scan that is skipped
        self._to_skip = 0  # scans of a requested overrun, which ends when they are due
        overlaps = settings.rate_hz * settings.scan_length > MOST_SAMPLES_A_SECOND
        self._announcement = (SCAN_OVERLAP, 0) if overlaps else None  # status and additional of the next packet

    def due(self, now_s: float) -> int:
        """Return the number of scans due by now."""
        return max(0, math.floor((now_s - self._settings.first_s) * self._settings.rate_hz - ROUNDING) + 1)

    def instant_s(self, scan: int) -> float:
        """Return the instant of a scan."""
        return self._settings.first_s + scan / self._settings.rate_hz

    @property
    def next_packet_s(self) -> float:
        """The time when the next packet will be full."""
        return self.full_s(0)

    def full_s(self, ahead: int) -> float:
        """Return the time when the packet after the next `ahead` packets will be full."""
        last = self._taken + self._to_skip + self._scans_for(ahead + 1) - 1
        return self.instant_s(last) + 2.0 * ROUNDING / self._settings.rate_hz

    def begins_s(self, ahead: int) -> float:
        """Return the instant of the first scan not yet taken of the packet after the next `ahead` packets."""
        return self.instant_s(self._taken + self._scans_for(ahead))

    @property
    def next_scan_s(self) -> float:
        """The instant of the next scan, which may be in the past."""
        return self.instant_s(self._taken)

    @property
    def next_packet(self) -> int:
        """The number of the next packet, from 0."""
        return self._transaction

    def overrun(self, scans: int) -> None:
        """Behave as with a full buffer: the next `scans` scans are skipped, reported and marked as usual."""
        self._kept_until, self._to_skip = self._taken, scans

    def fill(self, now_s: float, in_transit: int) -> None:
        """Count scans that became due while the wire took nothing; those up to `in_transit` had been sent before."""
        room = self._settings.buffer_bytes // (2 * self._settings.scan_length)
        if self._kept_until is None and self.due(now_s) - in_transit > room:
            self._kept_until = in_transit + room

    def packets(self, now_s: float, *, most: int | None = None) -> bytes:
        """Return the packets filled by a batch of due scans, at most `most` of them, or b""."""
        due = self.due(now_s)
        if self._kept_until is not None and self._taken >= self._kept_until:
            if due - self._taken < self._to_skip:
                return b""
            self._end_recovery(self._taken + self._to_skip if self._to_skip else due)
        batch = LARGEST_BATCH if most is None else min(self._scans_for(most), LARGEST_BATCH)
        scans = min((due if self._kept_until is None else self._kept_until) - self._taken, batch)
        if scans > 0:
            samples = self._settings.sample(self._taken, scans)
            self._rest = np.concatenate((self._rest, samples.reshape(-1)))
            self._taken += scans
        return self._full_packets(due)

    def finish(self, now_s: float) -> None:
        """Take all due scans that fit, so that their number does not depend on the progress of the sender."""
        if self._to_skip:
            self._kept_until, self._to_skip = None, 0
        self.fill(now_s, in_transit=self._taken)
        while not self.over and self._taken < self.due(now_s):
            self.packets(now_s)

    def _scans_for(self, packets: int) -> int:
        """Return the number of scans needed to fill `packets` packets."""
        missing = packets * self._settings.samples_per_packet - len(self._rest)
        return max(0, math.ceil(missing / self._settings.scan_length))

    def _end_recovery(self, due: int) -> None:
        skipped = max(1, due - self._taken)  # the dummy scan replaces the first of them
        self._kept_until, self._to_skip = None, 0
        self._taken += skipped
        self._rest = np.concatenate((self._rest, np.full(self._settings.scan_length, DUMMY, np.uint16)))
        self._announcement = (AUTO_RECOVER_END, skipped) if skipped <= 0xFFFF else (SKIP_OVERFLOW, 0)

    def _full_packets(self, due: int) -> bytes:
        width = self._settings.samples_per_packet
        count = len(self._rest) // width
        if not count:
            return b""
        status = np.full(count, 0 if self._kept_until is None else AUTO_RECOVER_ACTIVE)
        additional = np.zeros(count, np.int64)
        if self._announcement is not None:
            status[0], additional[0] = self._announcement
            if status[0] != AUTO_RECOVER_END:
                self.over, count = True, 1
            self._announcement = None
        complete, self._rest = self._rest[: count * width].reshape(count, width), self._rest[count * width :]
        behind = (due - self._taken) * self._settings.scan_length + len(self._rest)
        waiting = behind + width * np.arange(count - 1, -1, -1)
        first_transaction, self._transaction = self._transaction, self._transaction + count
        return encode_packets(
            complete,
            first_transaction=first_transaction,
            backlog_bytes=2 * np.maximum(waiting, 0),
            status=status[:count],
            additional=additional[:count],
        )


SEND_BUFFER_BYTES = 1 << 16  # small, as in the instrument: a client that does not read is detected
MOST_AHEAD = 256  # packets that are checked for faults, and sampled, at once
PATIENCE_S = 0.02  # wall time between two checks for other changes


class T7StreamServer:
    """Sends the packets of successive streams to the latest client.

    It only waits while no stream runs, so that bench time may jump at no cost. Scans that become due in one jump count
    as sent; only scans that become due while the wire takes nothing fill the instrument's buffer. A new client receives
    complete packets. `faults` apply to the packets of later streams.
    """

    def __init__(self, inputs: AnalogInputs) -> None:
        self.faults: PendingFaults[StreamFault] | None = None
        self._inputs = inputs
        self._latest = LatestClient(send_buffer_bytes=SEND_BUFFER_BYTES)
        self._thread: threading.Thread | None = None
        self._stopping = False
        self._changed = threading.Condition()
        self._stream: StreamBuffer | None = None

    @property
    def address(self) -> str:
        """`tcp://HOST:PORT`, with the actual port while it runs."""
        return self._latest.address

    def start(self) -> None:
        """Listen; when it returns, a client can connect."""
        if self._thread is not None:
            return
        self._latest.open()
        self._stopping = False
        self._thread = threading.Thread(target=self._serve, name=f"stream {self.address}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the stream, close everything and join the thread; safe to call twice."""
        with self._changed:
            self._stopping, self._stream = True, None
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()
        self._latest.close()
        self._thread = None

    @property
    def running(self) -> bool:
        """Whether a stream runs."""
        return self._stream is not None

    def begin(self, stream: StreamBuffer) -> None:
        """Start to send a stream."""
        with self._changed:
            self._inputs.hold_history(stream.next_scan_s)
            self._stream = stream
            self._changed.notify_all()

    def end(self) -> None:
        """End the stream after taking every due scan.

        After the return nothing is sampled or sent, so that a client of the next stream receives only that one.
        """
        with self._changed:
            if self._stream is not None:
                self._stream.finish(self._inputs.now())
            self._stream = None
            self._inputs.hold_history(None)

    def _serve(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopping or self._stream is not None)
                stream = self._stream
            if stream is None:
                return
            if self.faults is None:
                self._run(stream)
            else:
                self._run_with_faults(stream, self.faults)

    def _run(self, stream: StreamBuffer) -> None:
        while self._stream is stream:
            now_s = self._inputs.now()
            packets = self._packets(stream, now_s)
            if packets:
                self._send(stream, packets, stream.due(now_s))
            self._end_or_wait(stream)

    def _run_with_faults(self, stream: StreamBuffer, faults: PendingFaults[StreamFault]) -> None:
        """Do the same as `_run`, but send a packet with a fault separately, after the valid ones before it."""
        sound, fault, lost = 0, None, 0
        while self._stream is stream:
            now_s = self._inputs.now()
            while fault is None and sound < MOST_AHEAD and stream.full_s(sound) <= now_s:
                fault = faults.due(f"packet {stream.next_packet + sound}", stream.begins_s(sound))
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
                    self._send(stream, kept, stream.due(now_s))
            elif fault is not None:
                packet = self._packets(stream, now_s, most=1)
                if isinstance(fault, StreamGap):
                    lost = fault.packets - 1
                else:
                    self._send_with_fault(fault, stream, packet)
                fault = None
            self._end_or_wait(stream)

    def _end_or_wait(self, stream: StreamBuffer) -> None:
        """End a stream that is over; otherwise wait for its next packet."""
        if stream.over:
            self._end_if(stream)
        elif stream.next_packet_s > self._inputs.now():
            self._inputs.wait_until(stream.next_packet_s, PATIENCE_S)

    def _send_with_fault(self, fault: StreamFault, stream: StreamBuffer, packet: bytes) -> None:
        in_transit = stream.due(self._inputs.now())
        if isinstance(fault, StreamEnds):
            self._end_if(stream)
        elif isinstance(fault, StreamCut):
            self._cut(stream, packet)
        else:
            if isinstance(fault, StreamStalls):
                self._stall(fault.for_s, stream, in_transit)
            junk = JUNK if isinstance(fault, StreamJunk) else b""
            self._send(stream, junk + packet, in_transit)

    def _cut(self, stream: StreamBuffer, packet: bytes) -> None:
        with self._changed:
            if self._stream is stream:
                self._accept_all()
                self._latest.send(memoryview(packet)[: len(packet) // 2])
                self._latest.drop()

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

    def _send(self, stream: StreamBuffer, packets: bytes, in_transit: int) -> None:
        left, client = memoryview(packets), self._latest.client
        while left:
            with self._changed:
                if self._stream is not stream:
                    return
                self._accept_all()
                if self._latest.client is not client:  # the new one gets the packet from its beginning
                    sent = len(packets) - len(left)
                    left, client = memoryview(packets)[sent - sent % stream.packet_bytes :], self._latest.client
                count = self._latest.send(left)
            left = left[count:]
            if not count:
                stream.fill(self._inputs.now(), in_transit)
                self._latest.accepts(PATIENCE_S, writing=True)

    def _accept_all(self) -> None:
        """Accept the latest of all waiting clients."""
        while self._latest.accepts(0.0):
            pass
