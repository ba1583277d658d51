"""Blocks of rows: those that stay in a core's own memory, and those over which sums are taken to see how they scatter.

The latter are half a second each, or a step each.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray

BLOCK = 64
"""Rows of a block."""

_TOGETHER = BLOCK << 7
"""Rows of some columns that stay in a core's own memory."""


def in_cache(rows: slice) -> Iterator[slice]:
    """Rows from the first to the last, so many at a time that one pass after another finds them in a core's memory."""
    for first in range(rows.start, rows.stop, _TOGETHER):
        yield slice(first, min(first + _TOGETHER, rows.stop))


def gram(columns: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The products of columns (n, k) with each other, shape (k, k)."""
    total = np.zeros((columns.shape[1], columns.shape[1]))
    for rows in in_cache(slice(0, len(columns))):
        # dot would let other threads work meanwhile, but takes several times as long where columns lie far apart
        total += columns[rows].T @ columns[rows]
    return total


def block_starts(rows: int) -> npt.NDArray[np.int64]:
    """The first row of each block of so many rows, as `numpy.add.reduceat` takes them."""
    return np.arange(0, rows, BLOCK)


def block_products(
    columns: npt.NDArray[np.floating[Any]], values: npt.NDArray[np.floating[Any]]
) -> npt.NDArray[np.float64]:
    """Σ of columns (n, k) times values (n,) over each block of rows, shape (blocks, k)."""
    rows, many = columns.shape
    whole, left = divmod(rows, BLOCK)
    cut = whole * BLOCK
    sums = np.empty((whole + (left > 0), many))
    sums[:whole] = (values[:cut].reshape(whole, 1, BLOCK) @ columns[:cut].reshape(whole, BLOCK, many))[:, 0]
    sums[whole:] = values[cut:] @ columns[cut:]
    return sums


def step_starts(step: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """The first row of each step, for the step of each row, shape (n,), n at least 1."""
    return np.concatenate([[0], np.flatnonzero(np.diff(step)) + 1])


def block_mean(values: FloatArray, size: int) -> FloatArray:
    """Means over blocks of so many values, shape (n // size,); what is left at the end is dropped."""
    count = values.size // size
    return np.asarray(values[: count * size].reshape(count, size).mean(axis=1))


def consecutive(sizes: Sequence[int]) -> tuple[slice, ...]:
    """Slices of these sizes, one after the other."""
    bounds = np.concatenate([[0], np.cumsum(sizes)]).tolist()
    return tuple(slice(first, last) for first, last in itertools.pairwise(bounds))
