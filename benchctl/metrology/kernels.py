"""The inner loops of Allan deviations in numpy; `kernels_numba` has compiled versions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray

RUN = 1 << 15
"""Points processed at a time, which fit into a core's cache."""
_LINE = 64
"""Bytes of a cache line, and of the widest registers."""


def room(points: int) -> FloatArray:
    """Return an uninitialised array of shape (points,), aligned to a cache line for fast loading."""
    wider = np.empty(points + _LINE // 8)
    return wider[-(wider.__array_interface__["data"][0] // 8) % (_LINE // 8) :][:points]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kernels:
    """The two kernels; both release the GIL.

    `running_sums(rates, mean, sums)` fills `sums` with the running sums of the rates minus their mean, row by row, and
    returns the last of each row; rates and sums have shape (rows, n).
    `squares(phase, lags, begin, end)` returns the sums of squares, shape (k,), of the second differences that begin
    at these points, over lags of shape (k,) that fit into a core's cache; a difference that would end after the phase
    does not count.
    """

    running_sums: Callable[[FloatArray, float, FloatArray], FloatArray]
    squares: Callable[[FloatArray, IntArray, int, int], FloatArray]


def by_numpy() -> Kernels:
    """Return the kernels of numpy: one pass through the cache computes differences, another sums their squares."""
    return Kernels(running_sums=running_sums, squares=squares)


def running_sums(rates: FloatArray, mean: float, sums: FloatArray) -> FloatArray:
    """See `Kernels`."""
    points = rates.shape[1]
    kept = room(min(RUN, points))
    for row, sums_of_row in zip(rates, sums, strict=True):
        before = 0.0
        for begin in range(0, points, RUN):
            centred = np.subtract(row[begin : begin + RUN], mean, out=kept[: points - begin])
            centred[0] += before
            before = np.cumsum(centred, out=sums_of_row[begin : begin + RUN])[-1]
    return sums[:, -1].copy()


def squares(phase: FloatArray, lags: IntArray, begin: int, end: int) -> FloatArray:
    """See `Kernels`; all lags process one run of points before the next."""
    widest = min(RUN, phase.size) + int(lags.max(initial=0))
    widest += -widest % 8
    rooms = room(2 * widest).reshape(2, widest)
    sums = np.zeros(lags.size)
    for first in range(begin, end, RUN):
        last = min(first + RUN, end)
        for place, lag in enumerate(lags.tolist()):
            values = phase[first : last + 2 * lag]
            if values.size > 2 * lag:
                for kept in rooms:
                    values = np.subtract(values[lag:], values[:-lag], out=kept[: values.size - lag])
                sums[place] += values @ values
    return sums
