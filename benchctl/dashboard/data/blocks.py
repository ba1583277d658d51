"""Samples in blocks: of each block when it begins and ends, its lowest and its highest value, and how many it holds.

Rows of a block, as columns of an array of shape (blocks, 5): `FIRST`, `LAST` [s], `LOW`, `HIGH`, `COUNT`. A block
is never a choice among its samples: its lowest and highest are those of all of them. A sample that is no number counts,
but is neither lowest nor highest; a block of only such has NaN for both.
"""

from __future__ import annotations

import numpy as np

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


def runs(mask: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Where a mask is true: stretches, each from `first` until before `end`."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]
