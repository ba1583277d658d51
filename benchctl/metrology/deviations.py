"""The Allan deviation and its relatives, of a rate that is sampled evenly.

All are statistics of the integrated rate x, which NIST calls phase: x has one point more than there are samples, and
begins at 0. Each takes the sum of rates only once, whatever the averaging time, and costs a pass a time.

Source: W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008), section 5.2. The
tests hold them against the numbers that it prints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
import numpy.typing as npt

from instruments.errors import UsageError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

Kind = Literal["adev", "oadev", "mdev", "tdev", "hdev", "ohdev", "totdev"]


def deviation(rates: FloatArray, factors: IntArray, interval_s: float, kind: Kind = "oadev") -> FloatArray:
    """The deviations of rates of shape (n,), sampled every `interval_s`, over `factors` samples each, shape (k,).

    In the unit of the rates; `tdev` in that unit times seconds. NaN where the record is too short for a factor.

    Raises
    ------
    UsageError
        For rates that are not finite, fewer than three of them, or factors below 1.
    """
    if rates.ndim != 1 or rates.size < 3 or not np.isfinite(rates).all():
        raise UsageError(f"expected at least 3 finite rates in a row, got {rates.size} of shape {rates.shape}")
    if factors.size and int(factors.min()) < 1:
        raise UsageError(f"expected averaging factors of at least 1, got {int(factors.min())}")
    phase = _phase(rates)
    variance = _VARIANCES[kind]
    found = np.array([variance(phase, m) for m in factors.tolist()])
    if kind == "tdev":
        found *= (factors * interval_s) ** 2 / 3.0
    return np.asarray(np.sqrt(found))


def _phase(rates: FloatArray) -> FloatArray:
    """The integrated rate in units of the sampling interval, shape (n + 1,).

    The mean, which no difference of rates knows, is left out, so that the sum of 10⁸ samples keeps its digits.
    """
    phase = np.empty(rates.size + 1)
    phase[0] = 0.0
    np.cumsum(rates - rates.mean(), out=phase[1:])
    return phase


def _mean_square(values: FloatArray) -> float:
    return float(values @ values) / values.size if values.size else math.nan


def _allan(phase: FloatArray, m: int) -> float:
    """Non-overlapping."""
    averages = np.diff(phase[::m]) / m
    return 0.5 * _mean_square(np.diff(averages))


def _overlapping_allan(phase: FloatArray, m: int) -> float:
    """Of all differences, each beginning one sample after the other."""
    if phase.size <= 2 * m:
        return math.nan
    second = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m]
    return _mean_square(second) / (2.0 * m * m)


def _modified_allan(phase: FloatArray, m: int) -> float:
    """The second differences are averaged over the averaging time too."""
    if phase.size < 3 * m:
        return math.nan
    second = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m]
    sums = np.concatenate([np.zeros(1), np.cumsum(second)])
    return _mean_square((sums[m:] - sums[:-m]) / m) / (2.0 * m * m)


def _hadamard(phase: FloatArray, m: int) -> float:
    """Non-overlapping."""
    averages = np.diff(phase[::m]) / m
    return _mean_square(np.diff(averages, n=2)) / 6.0


def _overlapping_hadamard(phase: FloatArray, m: int) -> float:
    """Of all differences, each beginning one sample after the other."""
    if phase.size <= 3 * m:
        return math.nan
    third = phase[3 * m :] - 3.0 * phase[2 * m : -m] + 3.0 * phase[m : -2 * m] - phase[: -3 * m]
    return _mean_square(third) / (6.0 * m * m)


def _total(phase: FloatArray, m: int) -> float:
    """The phase is continued by its own reflection about either end."""
    if not m < phase.size - 1:
        return math.nan
    before = 2.0 * phase[0] - phase[m:0:-1]
    behind = 2.0 * phase[-1] - phase[-2 : -m - 2 : -1]
    longer = np.concatenate([before, phase, behind])
    second = longer[2 * m :] - 2.0 * longer[m:-m] + longer[: -2 * m]
    return _mean_square(second[1:-1]) / (2.0 * m * m)


_VARIANCES: Mapping[Kind, Callable[[FloatArray, int], float]] = {
    "adev": _allan,
    "oadev": _overlapping_allan,
    "mdev": _modified_allan,
    "tdev": _modified_allan,
    "hdev": _hadamard,
    "ohdev": _overlapping_hadamard,
    "totdev": _total,
}
