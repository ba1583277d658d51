"""`kernels` compiled by numba: a difference is computed, squared and added in one pass, and never stored.

The loading of points limits the speed. Three lags, each twice the previous one, as in octave and decade grids, need
five points for their three second differences instead of nine, so they are computed together.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from benchctl.metrology.kernels import RUN
from benchctl_instruments.arrays import FloatArray, IntArray

# squares may be added in any order, several at once; no other relaxation of floating point is allowed
_ANY_ORDER = {"reassoc", "contract"}


@njit(nogil=True, cache=True)
def running_sums(rates: FloatArray, mean: float, sums: FloatArray) -> FloatArray:
    """See `Kernels`. Each sum of a row depends on the previous one, so two rows are processed at once."""
    rows = rates.shape[0]
    for row in range(0, rows - 1, 2):
        _two_running_sums(rates[row], rates[row + 1], mean, sums[row], sums[row + 1])
    if rows % 2:
        total = 0.0
        for k in range(rates.shape[1]):
            total += rates[-1, k] - mean
            sums[-1, k] = total
    return sums[:, -1].copy()


@njit(nogil=True, cache=True)
def _two_running_sums(
    one: FloatArray, other: FloatArray, mean: float, sums_of_one: FloatArray, sums_of_other: FloatArray
) -> None:
    total_of_one, total_of_other = 0.0, 0.0
    for k in range(one.size):
        total_of_one += one[k] - mean
        total_of_other += other[k] - mean
        sums_of_one[k] = total_of_one
        sums_of_other[k] = total_of_other


@njit(nogil=True, cache=True)
def squares(phase: FloatArray, lags: IntArray, begin: int, end: int) -> FloatArray:
    """See `Kernels`; all lags process one run of points before the next."""
    sums = np.zeros(lags.size)
    for first in range(begin, end, RUN):
        last = min(first + RUN, end)
        place = 0
        while place < lags.size:
            lag, alone_from = lags[place], first
            together = 3 if _each_twice_the_one_before(lags[place : place + 3]) else 1
            if together == 3:
                alone_from = max(first, min(last, phase.size - 8 * lag))
                sums[place : place + 3] += _second_over_three(phase, lag, first, alone_from)
            for one in range(place, place + together):
                sums[one] += _of_run(phase, lags[one], alone_from, last)
            place += together
    return sums


@njit(nogil=True, cache=True)
def _each_twice_the_one_before(lags: IntArray) -> bool:
    """Return whether each of three lags is twice the previous one."""
    return lags.size == 3 and lags[1] == 2 * lags[0] and lags[2] == 2 * lags[1]


@njit(nogil=True, cache=True, fastmath=_ANY_ORDER)
def _second_over_three(phase: FloatArray, lag: int, begin: int, end: int) -> FloatArray:
    """Return the sums over the lag, twice and four times the lag; from `begin` to `end` all three have a difference."""
    here, next_one, next_two = phase[begin:end], phase[begin + lag : end + lag], phase[begin + 2 * lag : end + 2 * lag]
    next_four, next_eight = phase[begin + 4 * lag : end + 4 * lag], phase[begin + 8 * lag : end + 8 * lag]
    over_one, over_two, over_four = 0.0, 0.0, 0.0
    for k in range(here.size):
        one = next_two[k] - 2.0 * next_one[k] + here[k]
        two = next_four[k] - 2.0 * next_two[k] + here[k]
        four = next_eight[k] - 2.0 * next_four[k] + here[k]
        over_one += one * one
        over_two += two * two
        over_four += four * four
    return np.array([over_one, over_two, over_four])


@njit(nogil=True, cache=True, fastmath=_ANY_ORDER)
def _of_run(phase: FloatArray, lag: int, begin: int, end: int) -> float:
    end = min(end, phase.size - 2 * lag)
    if end <= begin:
        return 0.0
    first, second, third = phase[begin:end], phase[begin + lag : end + lag], phase[begin + 2 * lag : end + 2 * lag]
    total = 0.0
    for k in range(first.size):
        one = third[k] - 2.0 * second[k] + first[k]
        total += one * one
    return total
