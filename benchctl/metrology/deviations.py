"""The Allan deviation and its relatives, of a rate that is sampled evenly.

All are mean squares of differences of the integrated rate x, which NIST calls phase: x has one point more than there
are samples, and begins at 0. What takes the time is in `kernels`.

Source: W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008), section 5.2. The
tests hold them against the numbers that it prints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import partial
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from benchctl.metrology.differences import sums_of_squares
from benchctl.metrology.kernels import FloatArray, IntArray, Kernels, kernels_for
from benchctl.metrology.moving import sums_of_squared_averages
from benchctl.metrology.phase import integrated
from benchctl_instruments.errors import UsageError

Kind = Literal["adev", "oadev", "mdev", "tdev", "hdev", "ohdev", "totdev"]

_ALONE = np.array([1])
_MANY = 10_000
"""From so many terms on BLAS adds squares up on several threads, which only wait for one another, and for ours."""


def deviation(rates: FloatArray, factors: IntArray, interval_s: float, kind: Kind = "oadev") -> FloatArray:
    """The deviations of rates of shape (n,), sampled every `interval_s`, over `factors` samples each, shape (k,).

    In the unit of the rates; `tdev` in that unit times seconds. NaN where the record is too short for a factor. It
    works on all cores, and in as much memory again as the rates take.

    Raises
    ------
    UsageError
        For rates that are not finite, fewer than three of them, or factors below 1.
    """
    if factors.size and int(factors.min()) < 1:
        raise UsageError(f"expected averaging factors of at least 1, got {int(factors.min())}")
    kernels = kernels_for(rates.size * factors.size)
    phase = integrated(rates, kernels)
    with threadpool_limits(limits=1, user_api="blas") if phase.size > _MANY else nullcontext():
        variance = _VARIANCES[kind](phase, factors, kernels)
    found = np.asarray(np.sqrt(variance))
    return found * factors * (interval_s / np.sqrt(3.0)) if kind == "tdev" else found


def _overlapping(phase: FloatArray, factors: IntArray, kernels: Kernels, order: int) -> FloatArray:
    """Of all differences, each beginning one sample after the other."""
    return _mean(sums_of_squares(phase, factors, order, kernels), phase.size - order * factors, factors, order)


def _apart(phase: FloatArray, factors: IntArray, kernels: Kernels, order: int) -> FloatArray:
    """Of differences that begin an averaging time after each other."""
    ends = (np.ascontiguousarray(phase[::m]) for m in factors.tolist())
    sums = [sums_of_squares(each, _ALONE, order, kernels)[0] for each in ends]
    return _mean(np.array(sums), (phase.size - 1) // factors + 1 - order, factors, order)


def _modified(phase: FloatArray, factors: IntArray, _: Kernels) -> FloatArray:
    """The differences are averaged over the averaging time too."""
    return _mean(sums_of_squared_averages(phase, factors), phase.size - 3 * factors + 1, factors, 2)


def _total(phase: FloatArray, factors: IntArray, kernels: Kernels) -> FloatArray:
    """The phase is continued by its own reflection about either end."""
    sums = [sums_of_squares(_reflected(phase, m), np.array([m]), 2, kernels)[0] for m in factors.tolist()]
    return _mean(np.array(sums), np.where(factors < phase.size - 1, phase.size - 2, 0), factors, 2)


def _reflected(phase: FloatArray, m: int) -> FloatArray:
    """As many points longer at either end as have a difference that reaches into the phase."""
    before = 2.0 * phase[0] - phase[m - 1 : 0 : -1]
    behind = 2.0 * phase[-1] - phase[-2 : -m - 1 : -1]
    return np.concatenate([before, phase, behind])


def _mean(sums: FloatArray, terms: IntArray, factors: IntArray, order: int) -> FloatArray:
    """Of squared differences of averages of white noise, of which one has 2 or 6 variances; NaN of no terms."""
    size = {2: 2.0, 3: 6.0}[order]
    return np.where(terms > 0, sums, np.nan) / (size * np.maximum(terms, 1) * factors**2.0)


_VARIANCES: Mapping[Kind, Callable[[FloatArray, IntArray, Kernels], FloatArray]] = {
    "adev": partial(_apart, order=2),
    "oadev": partial(_overlapping, order=2),
    "mdev": _modified,
    "tdev": _modified,
    "hdev": partial(_apart, order=3),
    "ohdev": partial(_overlapping, order=3),
    "totdev": _total,
}
