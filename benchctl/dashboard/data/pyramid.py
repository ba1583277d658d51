"""Blocks in levels, each of sixteen of the level below: a view takes the coarsest ones that are fine enough for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchctl.dashboard.data.blocks import COLUMNS, FANOUT, FIRST, LAST, coarser, runs
from benchctl.dashboard.data.envelope import Envelope
from benchctl_instruments.arrays import FloatArray

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
                left += _put(envelope, rows, first, longest_s)
            level -= 1
            waiting = left if level < 0 else [(FANOUT * first, FANOUT * end) for first, end in left]
        return waiting


def _put(envelope: Envelope, rows: FloatArray, begin: int, longest_s: float) -> list[Run]:
    """Put in what fits, and say which of the blocks, counted on from `begin`, touch the window and do not."""
    first_s, last_s = rows[:, FIRST], rows[:, LAST]
    touches = (last_s >= envelope.from_s) & (first_s <= envelope.to_s)
    fits = touches & (first_s >= envelope.from_s) & (last_s <= envelope.to_s) & (last_s - first_s < longest_s)
    envelope.add_blocks(rows[fits])
    return [(begin + first, begin + end) for first, end in runs(touches & ~fits)]
