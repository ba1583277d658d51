"""`kernels` by numpy: each difference is made in one pass through the cache, and its squares are added up in one."""

from __future__ import annotations

import numpy as np

from benchctl.metrology.kernels import RUN, FloatArray, IntArray, room


def running_sums(rates: FloatArray, mean: float, sums: FloatArray) -> FloatArray:
    """As `Kernels` says."""
    points = rates.shape[1]
    kept = room(min(RUN, points))
    for row, sums_of_row in zip(rates, sums, strict=True):
        before = 0.0
        for begin in range(0, points, RUN):
            centred = np.subtract(row[begin : begin + RUN], mean, out=kept[: points - begin])
            centred[0] += before
            before = np.cumsum(centred, out=sums_of_row[begin : begin + RUN])[-1]
    return sums[:, -1].copy()


def squares(phase: FloatArray, lags: IntArray, order: int, begin: int, end: int) -> FloatArray:
    """All lags take turns on one run of points after the other."""
    widest = min(RUN, phase.size) + (order - 1) * int(lags.max(initial=0))
    widest += -widest % 8
    rooms = room(2 * widest).reshape(2, widest)
    sums = np.zeros(lags.size)
    for first in range(begin, end, RUN):
        last = min(first + RUN, end)
        for place, lag in enumerate(lags.tolist()):
            values = phase[first : last + order * lag]
            if values.size > order * lag:
                for level in range(order):
                    values = np.subtract(values[lag:], values[:-lag], out=rooms[level % 2, : values.size - lag])
                sums[place] += values @ values
    return sums
