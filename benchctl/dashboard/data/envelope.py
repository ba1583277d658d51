"""Samples reduced for drawing: blocks of samples in levels, and of each pixel the lowest and the highest value.

Rows of a block, as columns of an array of shape (blocks, 5): `FIRST`, `LAST` [s], `LOW`, `HIGH`, `COUNT`. A block
is never a choice among its samples: its lowest and highest are those of all of them. A sample that is no number counts,
but is neither lowest nor highest; a block of only such has NaN for both.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchctl.recordings.runs import holding
from benchctl_instruments.arrays import FloatArray

FIRST, LAST, LOW, HIGH, COUNT = range(5)
COLUMNS = 5

BLOCK = 128
"""Samples in a block of the finest level. A view of more samples than are read at once has hundreds in a pixel."""
FANOUT = 16
"""Blocks of a level that become one of the next."""


def blocks_of(time_s: FloatArray, values: FloatArray, size: int = BLOCK) -> FloatArray:
    """The blocks of samples, each shape (n,): shape (ceil(n / size), 5), the last one with what is left."""
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
    """Each `FANOUT` blocks as one, shape (ceil(n / FANOUT), 5)."""
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
    """A window of time in pixels of equal width, filled bit by bit; a sample at its very end is in the last pixel.

    Samples are put where they belong. A block of samples is put, whole, where its first one belongs; the next pixel
    then begins behind its last one, so that what is said of a pixel is always said of the samples between its beginning
    and that of the next one, all of them.
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
        """How long a pixel is."""
        return (self.to_s - self.from_s) / len(self.low)

    @property
    def begins_s(self) -> FloatArray:
        """When each pixel begins, shape (pixels,)."""
        begins = self.edges_s[:-1].copy()
        begins[1:] = np.maximum(begins[1:], np.nextafter(self._reaches_s[:-1], np.inf))
        return begins

    def add_samples(self, time_s: FloatArray, values: FloatArray) -> None:
        """Put samples, each shape (n,), in; those outside the window are left out."""
        if len(time_s) > 1 and not (np.diff(time_s) >= 0).all():
            order = np.argsort(time_s, kind="stable")  # NaN come last, behind every edge
            time_s, values = time_s[order], values[order]
        cuts = self._cuts(time_s)
        self.samples += int(cuts[-1] - cuts[0])
        self._put(cuts, values, values)

    def add_blocks(self, rows: FloatArray) -> None:
        """Put blocks in, shape (n, 5) as in `blocks`; each lies inside the window."""
        if len(rows) > 1 and not (np.diff(rows[:, FIRST]) >= 0).all():
            rows = rows[np.argsort(rows[:, FIRST], kind="stable")]
        cuts = self._cuts(rows[:, FIRST])
        self.samples += int(rows[cuts[0] : cuts[-1], COUNT].sum())
        filled = self._put(cuts, rows[:, LOW], rows[:, HIGH])
        if filled.size:
            reaches_s = np.maximum.reduceat(rows[: cuts[-1], LAST], cuts[:-1][filled])
            self._reaches_s[filled] = np.maximum(self._reaches_s[filled], reaches_s)

    def _cuts(self, time_s: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Where each pixel begins among ascending times, and behind them where the last one ends."""
        cuts = np.searchsorted(time_s, self.edges_s)
        cuts[-1] = np.searchsorted(time_s, self.to_s, side="right")
        return cuts

    def _put(
        self, cuts: np.ndarray[tuple[int], np.dtype[np.intp]], low: FloatArray, high: FloatArray
    ) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Take what lies between the cuts into account; the pixels in which there is something."""
        filled = np.flatnonzero(cuts[1:] > cuts[:-1])
        if filled.size:
            starts, end = cuts[:-1][filled], cuts[-1]
            self.low[filled] = np.fmin(self.low[filled], np.fmin.reduceat(low[:end], starts))
            self.high[filled] = np.fmax(self.high[filled], np.fmax.reduceat(high[:end], starts))
        return filled


def or_none(values: FloatArray) -> list[float | None]:
    """Numbers as JSON has them: None for what is not finite."""
    told: list[float | None] = values.tolist()
    for place in np.flatnonzero(~np.isfinite(values)):
        told[place] = None
    return told


Run = tuple[int, int]
"""Blocks from the first until before the second."""

_FINE_ENOUGH = 0.25
"""Of a pixel: by no more does the beginning of a pixel move where a coarse block is put into it."""


class Pyramid:
    """The levels above the blocks of the finest one, which `read` reads: shape (n, 5), from a file or from memory.

    The levels are made by `extend`, as the blocks themselves are made.
    """

    def __init__(self, read: Callable[[int, int], FloatArray]) -> None:
        self._read = read
        self._levels: list[FloatArray] = []
        self.blocks = 0

    @property
    def nbytes(self) -> int:
        """What the levels take in memory."""
        return sum(level.nbytes for level in self._levels)

    def extend(self, blocks: int) -> None:
        """Take the finest blocks up to before `blocks` into the levels above."""
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
        """Put into an envelope what of its window is fine enough in blocks; the finest blocks that must be read whole.

        Those are blocks on a border of the window, and blocks longer than a pixel: a gap lies in them.
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
    """Put in what fits, and say which of the blocks, counted on from `begin`, touch the window and do not."""
    first_s, last_s = rows[:, FIRST], rows[:, LAST]
    touches = (last_s >= envelope.from_s) & (first_s <= envelope.to_s)
    fits = touches & (first_s >= envelope.from_s) & (last_s <= envelope.to_s) & (last_s - first_s < longest_s)
    envelope.add_blocks(rows[fits])
    return [(begin + run.start, begin + run.stop) for run in holding(touches & ~fits)]
