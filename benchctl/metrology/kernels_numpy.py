"""`kernels` by numpy: each difference is made in one pass through the cache, and its squares are added up in one."""

from __future__ import annotations

import numpy as np

from benchctl.metrology.kernels import RUN, FloatArray, IntArray


def running_sum(values: FloatArray, before: float, sums: FloatArray) -> float:
    """As `Kernels` says; `values` are used up."""
    values[0] += before
    return float(np.cumsum(values, out=sums)[-1])


def over_short(phase: FloatArray, lags: IntArray, order: int, begin: int, end: int) -> FloatArray:
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


def over_long(phase: FloatArray, lag: int, order: int) -> float:
    """From a run of points to the one that lies a lag behind it: every first difference is made once."""
    rooms = np.empty((order, 2, RUN))
    total = 0.0
    for first in range(0, min(lag, phase.size - order * lag), RUN):
        width = min(RUN, lag - first)
        held: list[FloatArray] = []
        """The last difference of each order, that of order 0 being the phase."""
        for number, begin in enumerate(range(first, phase.size, lag)):
            values = phase[begin : begin + width]
            for level in range(min(number, order)):
                room = rooms[level, number % 2, : values.size]
                earlier, held[level] = held[level], values
                values = np.subtract(values, earlier[: values.size], out=room)
            if number < order:
                held.append(values)
            else:
                total += float(values @ values)
    return total
