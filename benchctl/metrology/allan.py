"""Compute the Allan deviation and the noise coefficients with confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc

from benchctl.metrology.coefficients import DIGITS, LONGEST_SHARE, AllanScatter, Terms, interval_of, terms_of
from benchctl.metrology.deviations import deviation
from benchctl.metrology.series import Series
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

_NEAR = 0.05
"""Relative misfit up to which a coefficient is still useful."""
_CHANCE = 1e-6
"""Probability of a misfit by chance: in a thousand records none at any of some fifty averaging times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit:
    """The averaging time at which the deviation lies farthest from that of the terms, both in the series' unit.

    The five terms are fitted to any record. In one with a spectral line, correlated noise or a filter they may be wrong
    by an order of magnitude, and their intervals do not cover that. The place of the largest misfit is not the place of
    its cause: a line of 1 Hz can spoil the fit at a minute.
    """

    tau_s: float
    deviation: float
    modelled: float


def misfit_of(tau_s: FloatArray, deviation: FloatArray, modelled: FloatArray, freedom: FloatArray) -> Misfit | None:
    """Return the largest misfit over the fitted averaging times, all (k,); None where the terms describe the record.

    A misfit counts where it is significant by χ² with the degrees of freedom of the terms, and larger than 5 %.
    """
    apart = np.abs(deviation - modelled) / np.maximum(deviation, modelled)
    squares = freedom * (deviation / modelled) ** 2
    by_chance = 2.0 * np.minimum(chdtr(freedom, squares), chdtrc(freedom, squares))
    apart[by_chance > _CHANCE] = 0.0
    worst = int(np.argmax(apart))
    if apart[worst] <= _NEAR:
        return None
    return Misfit(tau_s=float(tau_s[worst]), deviation=float(deviation[worst]), modelled=float(modelled[worst]))


LEAST_SAMPLES = 90
"""Least number of samples for five averaging times up to a ninth of the record."""
_SPREADS = (1e-50, 1e50)
"""Range of samples whose fourth powers are finite."""
_PER_DECADE = 10
_LONGEST = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Allan:
    """The analysis of a series: arrays of shape (k,) over averaging times, `ci95` (k, 2), and the terms.

    `freedom` are the equivalent degrees of freedom of each variance, for the estimated noise (`AllanScatter`); `misfit`
    states where the terms do not describe the deviations, or None.
    """

    series: Series
    tau_s: FloatArray
    deviation: FloatArray
    ci95: FloatArray
    freedom: FloatArray
    terms: Terms
    misfit: Misfit | None


def averaging_factors(samples: int) -> IntArray:
    """Return integer factors, ten a decade, up to a third of the record; shape (k,)."""
    decades = np.log10(samples / _LONGEST)
    spread = 10.0 ** (np.arange(int(decades * _PER_DECADE) + 1) / _PER_DECADE)
    return np.unique(np.round(spread).astype(np.int64))


def analysed(series: Series) -> Allan:
    """Analyse an evenly sampled series.

    Raises
    ------
    UsageError
        Where it has too few samples, or they do not change, or change by no finite amount.
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
