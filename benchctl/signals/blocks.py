"""Blocks of rows: blocks that fit into a core's cache, and blocks whose sums show how much they scatter.

The latter are half a second or a step long.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray

BLOCK = 64
"""Number of rows in a block."""

_TOGETHER = BLOCK << 7
"""Number of rows of some columns that fit into a core's cache."""


def in_cache(rows: slice) -> Iterator[slice]:
    """Split rows into pieces small enough to stay in a core's cache over several passes."""
    for first in range(rows.start, rows.stop, _TOGETHER):
        yield slice(first, min(first + _TOGETHER, rows.stop))


def gram(columns: npt.NDArray[np.float64], first: int = 0) -> npt.NDArray[np.float64]:
    """Return the products of columns (n, k) with those from `first` on, shape (k, k − first)."""
    total = np.zeros((columns.shape[1], columns.shape[1] - first))
    for rows in in_cache(slice(0, len(columns))):
        # dot would let other threads work in parallel, but is several times slower for columns with large strides
        total += columns[rows].T @ columns[rows, first:]
    return total


def block_starts(rows: int) -> npt.NDArray[np.int64]:
    """Return the first row of each block, for `numpy.add.reduceat`."""
    return np.arange(0, rows, BLOCK)


def block_products(
    columns: npt.NDArray[np.floating[Any]], values: npt.NDArray[np.floating[Any]]
) -> npt.NDArray[np.float64]:
    """Return the sums of columns (n, k) times values (n,) over each block of rows, shape (blocks, k)."""
    rows, many = columns.shape
    full, left = divmod(rows, BLOCK)
    cut = full * BLOCK
    sums = np.empty((full + (left > 0), many))
    sums[:full] = (values[:cut].reshape(full, 1, BLOCK) @ columns[:cut].reshape(full, BLOCK, many))[:, 0]
    sums[full:] = values[cut:] @ columns[cut:]
    return sums


def step_starts(step: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the first row of each step from the step of each row, shape (n,), n at least 1."""
    return np.concatenate([[0], np.flatnonzero(np.diff(step)) + 1])


def block_mean(values: FloatArray, size: int) -> FloatArray:
    """Return means over blocks of `size` values, shape (n // size,); an incomplete block at the end is dropped."""
    count = values.size // size
    return np.asarray(values[: count * size].reshape(count, size).mean(axis=1))


def consecutive(sizes: Sequence[int]) -> tuple[slice, ...]:
    """Return consecutive slices of these sizes."""
    bounds = np.concatenate([[0], np.cumsum(sizes)]).tolist()
    return tuple(slice(first, last) for first, last in itertools.pairwise(bounds))
