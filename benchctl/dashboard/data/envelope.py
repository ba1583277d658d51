"""Reduction of samples for drawing: blocks of samples in levels, and the minimum and maximum of each pixel.

The columns of an array of blocks, shape (blocks, 5), are `FIRST`, `LAST` [s], `LOW`, `HIGH`, `COUNT`. A block never
contains a selection of samples: its minimum and maximum are over all of them. NaN samples are counted, but ignored in
minimum and maximum; a block with only NaN has NaN for both.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchctl.recordings.runs import holding
from benchctl_instruments.arrays import FloatArray

FIRST, LAST, LOW, HIGH, COUNT = range(5)
COLUMNS = 5

BLOCK = 128
"""Samples in a block of the finest level. A view too large for reading all samples has hundreds per pixel."""
FANOUT = 16
"""Blocks of a level that are merged into one of the next."""


def blocks_of(time_s: FloatArray, values: FloatArray, size: int = BLOCK) -> FloatArray:
    """Return the blocks of samples, each shape (n,), as shape (ceil(n / size), 5); the last one contains the rest."""
    count = len(values)
    starts = np.arange(0, count, size)
    rows = np.empty((len(starts), COLUMNS))
    if not count:
        return rows
    ends = np.minimum(starts + size, count)
    rows[:, FIRST] = time_s[starts]
    rows[:, LAST] = time_s[ends - 1]
    rows[:, LOW] = np.fmin.reduceat(values, starts)
    rows[:, HIGH] = np.fmax.reduceat(values, starts)
    rows[:, COUNT] = ends - starts
    return rows


def coarser(rows: FloatArray) -> FloatArray:
    """Merge every `FANOUT` blocks into one, shape (ceil(n / FANOUT), 5)."""
    starts = np.arange(0, len(rows), FANOUT)
    if not len(rows):
        return np.empty((0, COLUMNS))
    return np.stack(
        [
            np.fmin.reduceat(rows[:, FIRST], starts),
            np.fmax.reduceat(rows[:, LAST], starts),
            np.fmin.reduceat(rows[:, LOW], starts),
            np.fmax.reduceat(rows[:, HIGH], starts),
            np.add.reduceat(rows[:, COUNT], starts),
        ],
        axis=1,
    )


class Envelope:
    """A time window in pixels of equal width, filled step by step; a sample at its very end is in the last pixel.

    Samples are assigned to pixels by time. A block is assigned to the pixel of its first sample; the next pixel then
    begins after its last one, so that the values of a pixel always cover all samples from its start to the start of the
    next one.
    """

    def __init__(self, from_s: float, to_s: float, pixels: int) -> None:
        self.from_s, self.to_s = from_s, to_s
        self.edges_s: FloatArray = np.linspace(from_s, to_s, pixels + 1)
        self.low: FloatArray = np.full(pixels, np.nan)
        self.high: FloatArray = np.full(pixels, np.nan)
        self.samples = 0
        self._reaches_s: FloatArray = np.full(pixels, -np.inf)

    @property
    def width_s(self) -> float:
        """The width of a pixel in seconds."""
        return (self.to_s - self.from_s) / len(self.low)

    @property
    def begins_s(self) -> FloatArray:
        """The start of each pixel, shape (pixels,)."""
        begins = self.edges_s[:-1].copy()
        begins[1:] = np.maximum(begins[1:], np.nextafter(self._reaches_s[:-1], np.inf))
        return begins

    def add_samples(self, time_s: FloatArray, values: FloatArray) -> None:
        """Add samples, each shape (n,); those outside the window are ignored."""
        if len(time_s) > 1 and not (np.diff(time_s) >= 0).all():
            order = np.argsort(time_s, kind="stable")  # NaN are last, behind every edge
            time_s, values = time_s[order], values[order]
        cuts = self._cuts(time_s)
        self.samples += int(cuts[-1] - cuts[0])
        self._put(cuts, values, values)

    def add_blocks(self, rows: FloatArray) -> None:
        """Add blocks, shape (n, 5) as in `blocks`; each is inside the window."""
        if len(rows) > 1 and not (np.diff(rows[:, FIRST]) >= 0).all():
            rows = rows[np.argsort(rows[:, FIRST], kind="stable")]
        cuts = self._cuts(rows[:, FIRST])
        self.samples += int(rows[cuts[0] : cuts[-1], COUNT].sum())
        filled = self._put(cuts, rows[:, LOW], rows[:, HIGH])
        if filled.size:
            reaches_s = np.maximum.reduceat(rows[: cuts[-1], LAST], cuts[:-1][filled])
            self._reaches_s[filled] = np.maximum(self._reaches_s[filled], reaches_s)

    def _cuts(self, time_s: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Return the index of the first of ascending times in each pixel, and the end of the last pixel."""
        cuts = np.searchsorted(time_s, self.edges_s)
        cuts[-1] = np.searchsorted(time_s, self.to_s, side="right")
        return cuts

    def _put(
        self, cuts: np.ndarray[tuple[int], np.dtype[np.intp]], low: FloatArray, high: FloatArray
    ) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Update minimum and maximum with the values between the cuts; return the pixels with values."""
        filled = np.flatnonzero(cuts[1:] > cuts[:-1])
        if filled.size:
            starts, end = cuts[:-1][filled], cuts[-1]
            self.low[filled] = np.fmin(self.low[filled], np.fmin.reduceat(low[:end], starts))
            self.high[filled] = np.fmax(self.high[filled], np.fmax.reduceat(high[:end], starts))
        return filled


def or_none(values: FloatArray) -> list[float | None]:
    """Return numbers for JSON: None for those that are not finite."""
    numbers: list[float | None] = values.tolist()
    for place in np.flatnonzero(~np.isfinite(values)):
        numbers[place] = None
    return numbers


Run = tuple[int, int]
"""A range of blocks, end exclusive."""

_FINE_ENOUGH = 0.25
"""Maximum length of a coarse block in pixels, and therefore maximum shift of a pixel's start."""


class Pyramid:
    """The levels above the finest blocks, which `read` returns: shape (n, 5), from a file or from memory.

    The levels are computed by `extend`, while the blocks are computed.
    """

    def __init__(self, read: Callable[[int, int], FloatArray]) -> None:
        self._read = read
        self._levels: list[FloatArray] = []
        self.blocks = 0

    @property
    def nbytes(self) -> int:
        """Memory used by the levels."""
        return sum(level.nbytes for level in self._levels)

    def extend(self, blocks: int) -> None:
        """Include the finest blocks up to `blocks` (exclusive) in the levels above."""
        first, self.blocks = self.blocks, blocks
        rows = self._read(first - first % FANOUT, blocks)
        level = 0
        while True:
            keep = first // FANOUT
            above = coarser(rows)
            if level == len(self._levels):
                self._levels.append(np.empty((0, COLUMNS)))
            self._levels[level] = np.concatenate((self._levels[level][:keep], above))
            if len(self._levels[level]) <= FANOUT:
                break
            first = keep
            rows = self._levels[level][first - first % FANOUT :]
            level += 1

    def fill(self, envelope: Envelope) -> list[Run]:
        """Add sufficiently fine blocks of an envelope's window to it; return the finest blocks to be read completely.

        Those are blocks across a border of the window, and blocks longer than a pixel, which contain a gap.
        """
        level = len(self._levels)
        waiting: list[Run] = [(0, len(self._levels[-1]) if self._levels else 0)]
        while level >= 0:
            size = len(self._levels[level - 1]) if level else self.blocks
            longest_s = envelope.width_s * (_FINE_ENOUGH if level else 1.0)
            left: list[Run] = []
            for first, end in waiting:
                rows = self._levels[level - 1][first : min(end, size)] if level else self._read(first, min(end, size))
                left += _put_fitting(envelope, rows, first, longest_s)
            level -= 1
            waiting = left if level < 0 else [(FANOUT * first, FANOUT * end) for first, end in left]
        return waiting


def _put_fitting(envelope: Envelope, rows: FloatArray, begin: int, longest_s: float) -> list[Run]:
    """Add the blocks that fit; return those that touch the window but do not fit, counted from `begin`."""
    first_s, last_s = rows[:, FIRST], rows[:, LAST]
    touches = (last_s >= envelope.from_s) & (first_s <= envelope.to_s)
    fits = touches & (first_s >= envelope.from_s) & (last_s <= envelope.to_s) & (last_s - first_s < longest_s)
    envelope.add_blocks(rows[fits])
    return [(begin + run.start, begin + run.stop) for run in holding(touches & ~fits)]
