"""The overview of a track: its blocks, as far as they have been made, and what a view takes from them."""

from __future__ import annotations

import threading
from typing import Protocol

import numpy as np

from benchctl.dashboard.data.blocks import BLOCK, COLUMNS
from benchctl.dashboard.data.envelope import Envelope
from benchctl.dashboard.data.pyramid import Pyramid, Run
from benchctl.dashboard.data.tracks import Track
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

MOST_SAMPLES = 2_000_000
"""Samples that a view reads from a recording at the most: 0.2 s."""


class Blocks(Protocol):
    """Where blocks are kept while they are made, and after."""

    @property
    def rows(self) -> int:
        """How many there are."""

    @property
    def nbytes(self) -> int:
        """What they take in memory."""

    def read(self, first: int, end: int) -> FloatArray:
        """Blocks, shape (end - first, 5)."""

    def append(self, rows: FloatArray) -> None:
        """Add blocks, shape (n, 5)."""


class BlocksInMemory:
    """Blocks of what is small or still grows."""

    def __init__(self) -> None:
        self._rows: FloatArray = np.empty((0, COLUMNS))
        self.rows = 0

    def append(self, rows: FloatArray) -> None:
        """Add blocks, shape (n, 5)."""
        if self.rows + len(rows) > len(self._rows):
            larger = np.empty((2 * self.rows + len(rows), COLUMNS))
            larger[: self.rows] = self._rows[: self.rows]
            self._rows = larger
        self._rows[self.rows : self.rows + len(rows)] = rows
        self.rows += len(rows)

    def read(self, first: int, end: int) -> FloatArray:
        """See `Blocks`."""
        return self._rows[first:end]

    @property
    def nbytes(self) -> int:
        """What they take."""
        return self._rows.nbytes


class Overview:
    """The blocks of a track up to somewhere; a thread may extend it while others look at it.

    `failed` is why it cannot be made, in words; else empty.
    """

    def __init__(self, blocks: Blocks, *, failed: str = "") -> None:
        self.blocks = blocks
        self._pyramid = Pyramid(blocks.read)
        self._lock = threading.Lock()
        self.samples = 0
        self.complete = False
        self.failed = failed

    @property
    def nbytes(self) -> int:
        """What it takes in memory."""
        return self._pyramid.nbytes + self.blocks.nbytes

    def reached(self, blocks: int, samples: int, *, complete: bool = False) -> None:
        """Say how many blocks there are by now, of how many samples."""
        with self._lock:
            self._pyramid.extend(blocks)
            self.samples, self.complete = samples, complete

    def fill(self, envelope: Envelope, track: Track) -> int:
        """Put into an envelope all that is known by now of its window; the samples of the track that that covers.

        Raises
        ------
        UsageError
            Where the times of the track do not ascend: most blocks would have to be read whole.
        """
        with self._lock:
            waiting, samples = self._pyramid.fill(envelope), self.samples
        if BLOCK * sum(end - first for first, end in waiting) > MOST_SAMPLES:
            raise UsageError(f"{track.path}: the times of channel {track.channel} do not ascend; it cannot be drawn")
        for first, end in waiting:
            _read_whole(envelope, track, (first, end))
        return samples


def _read_whole(envelope: Envelope, track: Track, run: Run) -> None:
    """Put in the samples of some blocks, one by one."""
    begin = 0
    for stretch in track.stretches:
        end = begin + -(-stretch.length // BLOCK)
        first, last = max(run[0], begin), min(run[1], end)
        if first < last:
            for time_s, values in stretch.strides((first - begin) * BLOCK, min((last - begin) * BLOCK, stretch.length)):
                envelope.add_samples(time_s, values)
        begin = end
