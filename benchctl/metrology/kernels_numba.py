"""`kernels` compiled by numba: a difference is made, squared and added up in one pass, and never stored."""

from __future__ import annotations

import numpy as np
from numba import njit

from benchctl.metrology.kernels import RUN, FloatArray, IntArray

# squares may be added up in any order, several at once; nothing else is taken lightly
_ANY_ORDER = {"reassoc", "contract"}


@njit(nogil=True, cache=True)
def running_sum(rates: FloatArray, mean: float, before: float, sums: FloatArray) -> float:
    """As `Kernels` says."""
    total = before
    for k in range(rates.size):
        total += rates[k] - mean
        sums[k] = total
    return total


@njit(nogil=True, cache=True)
def squares(phase: FloatArray, lags: IntArray, order: int, begin: int, end: int) -> FloatArray:
    """All lags take turns on one run of points after the other."""
    sums = np.zeros(lags.size)
    for first in range(begin, end, RUN):
        for place in range(lags.size):
            sums[place] += _of_run(phase, lags[place], order, first, min(first + RUN, end))
    return sums


@njit(nogil=True, cache=True)
def _of_run(phase: FloatArray, lag: int, order: int, begin: int, end: int) -> float:
    end = min(end, phase.size - order * lag)
    if end <= begin:
        return 0.0
    first, second, third = phase[begin:end], phase[begin + lag : end + lag], phase[begin + 2 * lag : end + 2 * lag]
    if order == 2:
        return _second(first, second, third)
    return _third(first, second, third, phase[begin + 3 * lag : end + 3 * lag])


@njit(nogil=True, cache=True, fastmath=_ANY_ORDER)
def _second(first: FloatArray, second: FloatArray, third: FloatArray) -> float:
    total = 0.0
    for k in range(first.size):
        one = third[k] - 2.0 * second[k] + first[k]
        total += one * one
    return total


@njit(nogil=True, cache=True, fastmath=_ANY_ORDER)
def _third(first: FloatArray, second: FloatArray, third: FloatArray, fourth: FloatArray) -> float:
    total = 0.0
    for k in range(first.size):
        one = fourth[k] - 3.0 * (third[k] - second[k]) - first[k]
        total += one * one
    return total
