"""Blocks of rows over which products are summed to see how they scatter: half a second each, or a step each."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

BLOCK = 64
"""Rows of a block."""


def block_starts(rows: int) -> npt.NDArray[np.int64]:
    """The first row of each block of so many rows, as `numpy.add.reduceat` takes them."""
    return np.arange(0, rows, BLOCK)


def step_starts(step: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """The first row of each step, for the step of each row, shape (n,), n at least 1."""
    return np.concatenate([[0], np.flatnonzero(np.diff(step)) + 1])
