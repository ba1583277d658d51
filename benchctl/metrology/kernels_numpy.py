"""`kernels` by numpy: each difference is made in one pass through the cache, and its squares are added up in one."""

from __future__ import annotations

import numpy as np

from benchctl.metrology.kernels import RUN, FloatArray, IntArray


def running_sum(values: FloatArray, before: float, sums: FloatArray) -> float:
    """As `Kernels` says; `values` are used up."""
    values[0] += before
    return float(np.cumsum(values, out=sums)[-1])


def squares(phase: FloatArray, lags: IntArray, order: int, begin: int, end: int) -> FloatArray:
    """All lags take turns on one run of points after the other."""
    rooms = np.empty((2, min(RUN, phase.size) + order * int(lags.max(initial=0))))
    sums = np.zeros(lags.size)
    for first in range(begin, end, RUN):
        last = min(first + RUN, end)
        for place, lag in enumerate(lags.tolist()):
            values = phase[first : last + order * lag]
            if values.size > order * lag:
                for level in range(order):
                    room = rooms[level % 2, : values.size - lag]
                    values = np.subtract(values[lag:], values[:-lag], out=room)
                sums[place] += values @ values
    return sums
