"""The stream of a simulated T7 between its inputs and the wire: scans when they are due, packets when they are full.

The instrument's buffer holds what the wire does not take. When it is full, scans are skipped and counted; once the wire
has taken what was kept, a dummy scan marks the gap and scanning goes on: `protocols.t7_stream` shows it.
"""

from __future__ import annotations

import math
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

MOST_SAMPLES_A_SECOND = 100_000
LARGEST_BATCH = 8192
ROUNDING = 1e-6  # of a scan interval: how long after its instant a scan counts as past

Samples = npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamSettings:
    """What a stream was asked to be.

    `sample` gives (start, scans) -> samples of that many scans from scan `start` on, shape (scans, `scan_length`).
    """

    first_s: float
    rate_hz: float
    scan_length: int
    samples_per_packet: int
    buffer_bytes: int
    sample: Callable[[int, int], Samples]


class StreamBuffer:
    """One stream, from its start to its end; no thread and no socket of its own.

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
        self._rest: Samples = np.empty(0, np.uint16)  # what fills no packet yet
        self._transaction = 0
        self._kept_until: int | None = None  # while it recovers: the first scan that is skipped
        self._to_skip = 0  # an overrun that was asked for: it ends when so many are due
        overlaps = settings.rate_hz * settings.scan_length > MOST_SAMPLES_A_SECOND
        self._announcement = (SCAN_OVERLAP, 0) if overlaps else None  # status and additional of the next packet

    def due(self, now_s: float) -> int:
        """How many scans should have been taken by now."""
        return max(0, math.floor((now_s - self._settings.first_s) * self._settings.rate_hz - ROUNDING) + 1)

    def instant_s(self, scan: int) -> float:
        """When a scan is taken."""
        return self._settings.first_s + scan / self._settings.rate_hz

    @property
    def next_packet_s(self) -> float:
        """When the next packet will be full."""
        return self.full_s(0)

    def full_s(self, ahead: int) -> float:
        """When the packet will be full before which there are `ahead` others."""
        last = self._taken + self._to_skip + self._scans_for(ahead + 1) - 1
        return self.instant_s(last) + 2.0 * ROUNDING / self._settings.rate_hz

    def begins_s(self, ahead: int) -> float:
        """The instant of the first scan yet to be taken for the packet before which there are `ahead` others."""
        return self.instant_s(self._taken + self._scans_for(ahead))

    @property
    def next_scan_s(self) -> float:
        """When the next scan is taken, or should have been."""
        return self.instant_s(self._taken)

    @property
    def next_packet(self) -> int:
        """The number of the next packet, from 0."""
        return self._transaction

    def overrun(self, scans: int) -> None:
        """Behave as with a full buffer: the next `scans` scans are skipped, which is said and marked as ever."""
        self._kept_until, self._to_skip = self._taken, scans

    def fill(self, now_s: float, in_transit: int) -> None:
        """Account for the scans due while the wire took nothing; those up to `in_transit` were on their way before."""
        room = self._settings.buffer_bytes // (2 * self._settings.scan_length)
        if self._kept_until is None and self.due(now_s) - in_transit > room:
            self._kept_until = in_transit + room

    def packets(self, now_s: float, *, most: int | None = None) -> bytes:
        """The packets that a batch of due scans fills, `most` of them at most; b"" where none is full yet."""
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
        """Take the scans that are due and fit: how many are sampled must not depend on how far the sender had come."""
        if self._to_skip:
            self._kept_until, self._to_skip = None, 0
        self.fill(now_s, in_transit=self._taken)
        while not self.over and self._taken < self.due(now_s):
            self.packets(now_s)

    def _scans_for(self, packets: int) -> int:
        """How many scans are yet to be taken until so many packets are full."""
        missing = packets * self._settings.samples_per_packet - len(self._rest)
        return max(0, math.ceil(missing / self._settings.scan_length))

    def _end_recovery(self, due: int) -> None:
        skipped = max(1, due - self._taken)  # the dummy scan stands for the first of them
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
        whole, self._rest = self._rest[: count * width].reshape(count, width), self._rest[count * width :]
        behind = (due - self._taken) * self._settings.scan_length + len(self._rest)
        waiting = behind + width * np.arange(count - 1, -1, -1)
        first_transaction, self._transaction = self._transaction, self._transaction + count
        return encode_packets(
            whole,
            first_transaction=first_transaction,
            backlog_bytes=2 * np.maximum(waiting, 0),
            status=status[:count],
            additional=additional[:count],
        )
