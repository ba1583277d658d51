"""Runs of samples: runs without a gap between two samples, and runs in which a condition holds.

A gap lies between two samples if the difference of their stamps differs from one sampling interval by more than half of
it. One missing sample makes a gap, and so does a clock that jumps back; the rounding of a stamp does not.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from benchctl_instruments.arrays import BoolArray, FloatArray

TOLERANCE = 0.5
"""Sampling intervals by which the distance of two neighbours on an even clock may differ from one interval."""


def gaps(steps_s: FloatArray, interval_s: float, tolerance: float = TOLERANCE) -> BoolArray:
    """Return where a gap lies, from the steps between stamps [s], shape (n,); `tolerance` is in units of `interval_s`.

    Polled samples are delayed by the answers before them, and need a wider tolerance than those of a hardware clock.
    """
    return np.asarray(
        (steps_s > (1.0 + tolerance) * interval_s) | (steps_s < (1.0 - tolerance) * interval_s), dtype=np.bool_
    )


def gap_free(time_s: FloatArray, interval_s: float, tolerance: float = TOLERANCE) -> list[slice]:
    """Return the runs without a gap, in order, of samples at these stamps [s], shape (n,); at least one."""
    starts = np.flatnonzero(gaps(np.diff(time_s), interval_s, tolerance)) + 1
    return [slice(first, last) for first, last in pairwise([0, *starts.tolist(), time_s.size])]


def holding(condition: BoolArray) -> list[slice]:
    """Return the runs of rows in which a condition, shape (n,), is true; empty if it never is."""
    edges = np.flatnonzero(np.diff(condition.astype(np.int8), prepend=0, append=0)).tolist()
    return [slice(first, last) for first, last in zip(edges[::2], edges[1::2], strict=True)]
