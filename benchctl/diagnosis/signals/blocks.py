"""Blocks of rows, half a second each, over which products are summed to see how they scatter."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

BLOCK = 64
"""Rows of a block."""


def block_starts(rows: int) -> npt.NDArray[np.int64]:
    """The first row of each block of so many rows, as `numpy.add.reduceat` takes them."""
    return np.arange(0, rows, BLOCK)
