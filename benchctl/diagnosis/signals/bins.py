"""Values sorted into bins of a coordinate."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray


def bin_of(values: FloatArray, edges: FloatArray) -> npt.NDArray[np.int64]:
    """Which bin each value lies in, shape (n,), for m+1 increasing edges; what lies beyond is in the outermost."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
