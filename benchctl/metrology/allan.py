"""An Allan analysis: deviations over averaging times with their intervals, and the terms that they are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.metrology.coefficients import DIGITS, LONGEST_SHARE, Terms, terms_of
from benchctl.metrology.deviations import deviation
from benchctl.metrology.misfit import Misfit, misfit_of
from benchctl.metrology.scatter import AllanScatter, interval_of
from benchctl.metrology.series import Series
from benchctl_instruments.errors import UsageError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LEAST_SAMPLES = 90
"""Fewer have no five averaging times up to a ninth of their record."""
_SPREADS = (1e-50, 1e50)
"""Of samples whose fourth powers, over any record, are numbers."""
_PER_DECADE = 10
_LONGEST = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Allan:
    """Of a series: arrays of shape (k,) over averaging times, `ci95` (k, 2), and the terms.

    `freedom` are the equivalent degrees of freedom of each variance, for the noise that was found (`scatter`); `misfit`
    is where the terms do not describe what they were fitted to, or None.
    """

    series: Series
    tau_s: FloatArray
    deviation: FloatArray
    ci95: FloatArray
    freedom: FloatArray
    terms: Terms
    misfit: Misfit | None


def averaging_factors(samples: int) -> IntArray:
    """Whole factors, ten a decade, up to a third of the record; shape (k,)."""
    decades = np.log10(samples / _LONGEST)
    spread = 10.0 ** (np.arange(int(decades * _PER_DECADE) + 1) / _PER_DECADE)
    return np.unique(np.round(spread).astype(np.int64))


def analysed(series: Series) -> Allan:
    """The analysis of an even series.

    Raises
    ------
    UsageError
        Where it has too few samples, or they do not change at all, or by what is no rate.
    """
    samples = series.values.size
    if samples < LEAST_SAMPLES:
        raise UsageError(f"{series.source}: {samples} samples are too few; expected at least {LEAST_SAMPLES}")
    least, most = float(series.values.min()), float(series.values.max())
    if least == most:
        raise UsageError(f"{series.source}: all {samples} samples are {least:g}; check that the unit was connected")
    if not _SPREADS[0] < most - least < _SPREADS[1]:  # NaN where a sample is
        raise UsageError(
            f"{series.source}: its samples lie from {least:g} to {most:g}, which gives no Allan deviation; "
            "check how they were stored"
        )
    factors = averaging_factors(samples)
    tau_s = np.asarray(factors * series.interval_s, dtype=np.float64)
    values = deviation(series.values, factors, series.interval_s)
    fitted = factors <= samples / LONGEST_SHARE
    scatter = AllanScatter(factors, samples, series.interval_s)
    terms = terms_of(values[fitted] ** 2, factors[fitted], series.interval_s, scatter)
    modelled = terms.modelled(tau_s, series.interval_s)
    expected = np.diag(scatter.covariance(terms.squares)) + (DIGITS * modelled) ** 2
    freedom = np.maximum(2.0 * modelled**2 / expected, 1.0)
    return Allan(
        series=series,
        tau_s=tau_s,
        deviation=values,
        ci95=interval_of(values, freedom),
        freedom=freedom,
        terms=terms,
        misfit=misfit_of(tau_s[fitted], values[fitted], np.sqrt(modelled[fitted]), freedom[fitted]),
    )
