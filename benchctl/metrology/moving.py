"""Sums of squares of second differences of a phase that are averaged over the averaging time too."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchctl.metrology.kernels import RUN, FloatArray, IntArray
from benchctl.side_by_side import cores, in_order

_LONG = 1 << 20
"""A phase of more points is worth several cores, each with a factor."""


def sums_of_squared_averages(phase: FloatArray, factors: IntArray) -> FloatArray:
    """Of all averages over m second differences in a row, for factors m of shape (k,); 0 where there is none."""
    workers = cores() if phase.size > _LONG else 1
    return np.array(list(in_order(partial(_of_one, phase), factors.tolist(), workers)))


def _of_one(phase: FloatArray, m: int) -> float:
    """An average is the one before, and a difference that comes in, and one that drops out."""
    averages = phase.size - 3 * m + 1
    if averages < 1:
        return 0.0
    rooms = np.empty((3, min(RUN, phase.size)))
    last = sum(float(_second(phase, m, k, min(k + RUN, m), rooms[:2]).sum()) for k in range(0, m, RUN))
    total = last**2
    for begin in range(0, averages - 1, RUN):
        end = min(begin + RUN, averages - 1)
        out = _second(phase, m, begin, end, rooms[:2])
        into = _second(phase, m, begin + m, end + m, rooms[1:])
        steps = np.subtract(into, out, out=out)
        steps[0] += last
        sums = np.cumsum(steps, out=rooms[1, : steps.size])
        total += float(sums @ sums)
        last = float(sums[-1])
    return total / m**2


def _second(phase: FloatArray, m: int, begin: int, end: int, rooms: FloatArray) -> FloatArray:
    """The second differences `begin` to `end`, in the first of two rooms."""
    later: FloatArray
    later, earlier = rooms[:, : end - begin]
    middle = phase[begin + m : end + m]
    np.subtract(phase[begin + 2 * m : end + 2 * m], middle, out=later)
    np.subtract(middle, phase[begin:end], out=earlier)
    later -= earlier
    return later
