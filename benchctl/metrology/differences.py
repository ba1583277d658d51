"""Sums of squares of the differences of a phase, each beginning one point after the other, over many lags.

A difference of order two is that of neighbouring averages, one of order three that of two such differences. They are
made and added up piece by piece (`kernels`), so that what is in work stays in a core's cache and no copy of the record
is made; several cores take a piece each. How many there are changes no bit of the sums.
"""

from __future__ import annotations

import numpy as np

from benchctl.metrology.kernels import SHORT, FloatArray, IntArray, Kernels
from benchctl.side_by_side import cores, in_order

_SPAN = 1 << 20
"""Points of a core's piece where the lags are short; where they are long, a lag is a piece."""


def sums_of_squares(phase: FloatArray, lags: IntArray, order: int, kernels: Kernels) -> FloatArray:
    """Of all differences of order 2 or 3, of a phase of shape (n,) over lags of shape (k,); 0 where there is none."""
    short, long = lags[lags <= SHORT], lags[lags > SHORT]
    begins = range(0, phase.size, _SPAN)
    workers = min(cores(), len(begins))
    sums = np.zeros(lags.size)

    def over_short(begin: int) -> FloatArray:
        return kernels.over_short(phase, short, order, begin, min(begin + _SPAN, phase.size))

    def over_long(lag: int) -> float:
        return kernels.over_long(phase, lag, order)

    for of_span in in_order(over_short, begins, workers):
        sums[lags <= SHORT] += of_span
    sums[lags > SHORT] = list(in_order(over_long, long.tolist(), workers))
    return sums
