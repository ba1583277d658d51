"""`kernels` by numpy: each difference is made in one pass through the cache, and its squares are added up in one."""

from __future__ import annotations

import numpy as np

from benchctl.metrology.kernels import RUN, FloatArray, IntArray


def running_sum(rates: FloatArray, mean: float, before: float, sums: FloatArray) -> float:
    """As `Kernels` says."""
    room = np.empty(min(RUN, rates.size))
    for begin in range(0, rates.size, RUN):
        centred = np.subtract(rates[begin : begin + RUN], mean, out=room[: rates.size - begin])
        centred[0] += before
        before = float(np.cumsum(centred, out=sums[begin : begin + RUN])[-1])
    return before


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
