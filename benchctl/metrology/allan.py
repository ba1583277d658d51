"""Compute the Allan deviation and estimate Q, N, B, K and R, each with its interval if the record shows it.

An Allan variance is modelled as the sum of five noises (IEEE Std 952, annex on the Allan variance),

    σ²(τ) = 3Q²/τ² + N²/τ + (2 ln 2/π)·B² + K²τ/3 + R²τ²/2

for a rate of unlimited bandwidth. For samples every τ0, whose noise ends at half their rate, two terms differ at short
averaging times: a walk has K²τ/3·(1 + τ0²/2τ²), and flicker is integrated from its density.

The variances at neighbouring averaging times share their samples: they are fitted by generalised least squares, with
the covariance of the noise estimated so far (`AllanScatter`) and non-negative squares (Stark and Parker, Computational
Statistics 10, 1995, which unlike Lawson and Hanson's search also terminates for a model that fits to the last digit).
The weights are those of the model, not of the data, so that values that are low by chance do not weigh more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear
from scipy.special import chdtr, chdtrc, chdtri
from threadpoolctl import threadpool_limits

from benchctl.metrology.deviations import deviation
from benchctl.metrology.series import Series
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

Term = Literal["Q", "N", "B", "K", "R"]
TERMS: tuple[Term, ...] = get_args(Term)

NAMES: Mapping[Term, str] = {
    "Q": "quantisation",
    "N": "angle random walk",
    "B": "bias instability",
    "K": "rate random walk",
    "R": "rate ramp",
}


@dataclass(frozen=True, slots=True)
class CoefficientUnit:
    """The unit of a coefficient, and the factor to it from the unit of the rates and seconds."""

    name: str
    factor: float


_OF_RATES: Mapping[Term, CoefficientUnit] = {
    "Q": CoefficientUnit("arcsec", 3600.0),
    "N": CoefficientUnit("deg/sqrt(h)", 60.0),
    "B": CoefficientUnit("deg/h", 3600.0),
    "K": CoefficientUnit("deg/h/sqrt(h)", 3600.0 * 60.0),
    "R": CoefficientUnit("deg/h/h", 3600.0 * 3600.0),
}
"""Units of IEEE Std 952, for rates in deg/s."""

_PER_SECONDS: Mapping[Term, str] = {"Q": "*s", "N": "/sqrt(Hz)", "B": "", "K": "/sqrt(s)", "R": "/s"}


def unit_of(term: Term, rate_unit: str) -> CoefficientUnit:
    """Return the unit of a coefficient for rates in `rate_unit`; for deg/s the unit of the standard."""
    return _OF_RATES[term] if rate_unit == "deg/s" else CoefficientUnit(f"{rate_unit}{_PER_SECONDS[term]}", 1.0)


def variances(tau_s: FloatArray, interval_s: float) -> FloatArray:
    """Return the contribution of each term of size one to σ² at averaging times (k,); (k, 5), ordered as `TERMS`."""
    walk = tau_s / 3.0 * (1.0 + 0.5 * (interval_s / tau_s) ** 2)
    flicker = np.array([_flicker(factor) for factor in (tau_s / interval_s).tolist()])
    return np.stack([3.0 / tau_s**2, 1.0 / tau_s, flicker, walk, 0.5 * tau_s**2], axis=1)


_MANY = 50.0
"""Number of samples above which the flicker variance equals its limit for continuous time."""


@lru_cache(maxsize=4096)
def _flicker(factor: float) -> float:
    """Return the Allan variance over `factor` samples of noise of density 1/(2πf) up to half the sampling rate.

    2/(π·m²) · ∫ sin⁴(m·x)/(x·sin²x) dx from 0 to π/2, by the filter of `AllanScatter`; it tends to 2 ln 2/π.
    """
    if factor > _MANY:
        return 2.0 * math.log(2.0) / math.pi
    x = np.linspace(0.0, 0.5 * math.pi, int(400 * factor) + 400)[1:]
    return float(2.0 / (math.pi * factor**2) * np.trapezoid(np.sin(factor * x) ** 4 / (x * np.sin(x) ** 2), x))


def densities(frequency_hz: FloatArray, interval_s: float) -> FloatArray:
    """Return the two-sided power density of each term of size one at frequencies (f,); shape (f, 5), unit²/Hz.

    These are densities of samples, valid up to half the sampling rate; a ramp has none, because it is deterministic.
    """
    difference = 2.0 * np.sin(math.pi * frequency_hz * interval_s)
    return np.stack(
        [
            difference**2 / interval_s,
            np.ones_like(frequency_hz),
            1.0 / (2.0 * math.pi * frequency_hz),
            interval_s**2 / difference**2,
            np.zeros_like(frequency_hz),
        ],
        axis=1,
    )


_NOISES = TERMS.index("R")
_POINTS = 6000
_LOWEST = 0.1
"""Lowest frequency, in units of half the reciprocal of the record's length."""


class AllanScatter:
    """The covariances of overlapping Allan variances of a record of `samples` every `interval_s`, for factors (k,).

    An Allan variance is the mean square of the filtered rates; the filter of averaging time m·τ0 has the gain

        |H(f)|² = 2·sin⁴(π·f·m·τ0) / (m·sin(π·f·τ0))².

    The mean squares of two such series of Gaussian noise, over n terms each, have the covariance

        2/(n·τ0) · ∫ |H_i|²·|H_j|²·S² df

    for records that are long compared with the averaging times; up to a ninth of the record it is accurate to a few
    percent. It is quadratic in the squared coefficients: the contribution of each pair of terms is computed once.
    """

    def __init__(self, factors: IntArray, samples: int, interval_s: float) -> None:
        highest_hz = 0.5 / interval_s
        edges_hz = np.geomspace(_LOWEST * highest_hz / samples, highest_hz, _POINTS + 1)
        # random points within the bins, so that at no averaging time all points have the same phase
        inside = np.random.default_rng(0).uniform(size=_POINTS)
        width_hz = np.diff(edges_hz)
        frequency_hz = edges_hz[:-1] + inside * width_hz
        noises = densities(frequency_hz, interval_s).T[:_NOISES]
        phase = (math.pi * interval_s) * frequency_hz[:, None]
        terms = (samples + 1 - 2 * factors).astype(np.float64)
        responses = math.sqrt(2.0) * np.sin(phase * factors) ** 2 / (factors * np.sin(phase))
        # each term of the shorter series is correlated with the longer one at all lags; both signs of frequency
        scale = 4.0 / (np.maximum.outer(terms, terms) * interval_s)
        self._of_two = np.array(
            [[scale * _products(responses**2, one * other * width_hz) for other in noises] for one in noises]
        )
        averaged = responses * np.sin(phase * terms) / (terms * np.sin(phase))
        # (a + z)² is a² + 2az + z², where a is due to a ramp and the mean of z over the record is not zero
        tau_s = factors * interval_s
        self._with_ramp = np.array(
            [4.0 * np.outer(tau_s, tau_s) * _products(averaged, one * width_hz) for one in noises]
        )

    def covariance(self, squares: FloatArray) -> FloatArray:
        """Return the covariance over all factors, shape (k, k), for squared coefficients (5,), ordered as `TERMS`."""
        noise, ramp = squares[:_NOISES], squares[_NOISES]
        together = np.einsum("t,u,tuij->ij", noise, noise, self._of_two)
        return np.asarray(together + ramp * np.einsum("t,tij->ij", noise, self._with_ramp))


def interval_of(deviation: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return 95 % intervals, (k, 2), of deviations (k,) whose squares have χ² with so many degrees of freedom."""
    quantiles = chdtri(freedom, np.array([0.025, 0.975])[:, None]) / freedom
    return np.asarray((deviation / np.sqrt(quantiles)).T)


def _products(columns: FloatArray, weights: FloatArray) -> FloatArray:
    return np.asarray(columns.T @ (columns * weights[:, None]))


LONGEST_SHARE = 9
"""Averaging times beyond this fraction of the record are shown but not fitted."""
_SHORTEST, _SHARE = 3, 1.0 / 3.0
"""A term is identified if it makes a third of the variance, at three samples or more."""
_ROUNDS = 6
"""Iterations of the reweighted fit."""
_SIGNIFICANT = 3.0
"""Minimum significance of a square, in standard deviations; at two, one white record in a hundred shows a ramp."""
_IMPERFECT = 0.003
"""Relative error of the model of a variance, whatever the length of the record."""
DIGITS = 1e-12
"""Relative numerical error of a deviation; it limits the accuracy of a variance without noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficient:
    """One term's coefficient, in units of the rate and seconds, with its 95 % interval."""

    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """The terms of a record; `refused` gives the reason for each term that it does not show.

    `squares` (5,) are the best-fitting squared coefficients of all terms, significant or not.
    """

    found: Mapping[Term, Coefficient]
    refused: Mapping[Term, str]
    squares: FloatArray

    def modelled(self, tau_s: FloatArray, interval_s: float) -> FloatArray:
        """Return the modelled variance over averaging times of shape (k,)."""
        return variances(tau_s, interval_s) @ self.squares


def terms_of(variance: FloatArray, factors: IntArray, interval_s: float, scatter: AllanScatter) -> Terms:
    """Estimate the terms from overlapping Allan variances, shape (k,), at the averaging factors to be fitted.

    `scatter` covers these factors, followed by longer ones.
    """
    columns = variances(np.asarray(factors * interval_s), interval_s)
    # no term changes faster than the square of the averaging time; a measured variance may be 0, a modelled one not
    apart = np.minimum.outer(factors, factors) / np.maximum.outer(factors, factors)
    least = (variance * apart**2).max(axis=1)
    active = list(range(len(TERMS)))
    refused: dict[Term, str] = {}
    squares, covariance = _fitted(columns, variance, least, scatter, active)
    best = squares
    while (weak := _insignificant(squares, covariance, active)) is not None:
        refused[TERMS[weak]] = "not distinguishable from zero"
        active.remove(weak)
        squares, covariance = _fitted(columns, variance, least, scatter, active)
    found: dict[Term, Coefficient] = {}
    shown = columns[factors >= _SHORTEST] * squares
    for row, place in enumerate(active):
        # an unidentified term stays in the fit, so that the other terms do not absorb it
        if (shown[:, place] >= _SHARE * shown.sum(axis=1)).any():
            found[TERMS[place]] = _coefficient(squares[place], covariance[row, row])
        else:
            refused[TERMS[place]] = "its slope lies outside the record, or below the other terms"
    return Terms(found=found, refused=refused, squares=best)


def _fitted(
    columns: FloatArray, variance: FloatArray, least: FloatArray, scatter: AllanScatter, active: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Fit the squares, shape (5,), and the covariance of the active ones; `least` (k,) bounds the model from below."""
    squares = np.zeros(len(TERMS))
    own = columns[:, active]
    if not active:
        return squares, np.zeros((0, 0))
    squares[active] = _not_negative(own / least[:, None], variance / least)
    for _ in range(_ROUNDS):
        missed = _IMPERFECT * np.maximum(columns @ squares, DIGITS * least)
        together = scatter.covariance(squares)[: variance.size, : variance.size]
        root = np.linalg.cholesky(together + np.diag(missed**2))
        white = solve_triangular(root, own, lower=True)
        squares[active] = _not_negative(white, solve_triangular(root, variance, lower=True))
    return squares, np.linalg.inv(white.T @ white)


def _not_negative(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Solve least squares without negative coefficients, for columns that differ by orders of magnitude."""
    lengths, length = np.linalg.norm(columns, axis=0), np.linalg.norm(wanted)
    found = lsq_linear(columns / lengths, wanted / length, (0.0, np.inf), method="bvls").x
    return np.asarray(found * (length / lengths))


def _insignificant(squares: FloatArray, covariance: FloatArray, active: list[int]) -> int | None:
    """Return the index of the least significant term; None if all are significant."""
    if not active:
        return None
    significance = squares[active] / np.sqrt(np.diag(covariance))
    weakest = int(np.argmin(significance))
    return active[weakest] if significance[weakest] < _SIGNIFICANT else None


def _coefficient(square: float, variance: float) -> Coefficient:
    value = math.sqrt(square)
    low, high = interval_of(np.array([value]), np.array([2.0 * square**2 / variance]))[0].tolist()
    return Coefficient(value=value, ci95=(low, high))


_NEAR = 0.05
"""Relative misfit up to which a coefficient is still useful."""
_CHANCE = 1e-6
"""Probability of a misfit by chance: none expected in a thousand records with some fifty averaging times each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit:
    """The averaging time at which the deviation differs most from that of the terms, both in the series' unit.

    The five terms are fitted to any record. For one with a spectral line, correlated noise or a filter they may be
    wrong by an order of magnitude, and their intervals do not cover that. The largest misfit is not necessarily at the
    averaging time of its cause: a line of 1 Hz can spoil the fit at a minute.
    """

    tau_s: float
    deviation: float
    modelled: float


def misfit_of(tau_s: FloatArray, deviation: FloatArray, modelled: FloatArray, freedom: FloatArray) -> Misfit | None:
    """Return the largest misfit over the fitted averaging times, all (k,); None if the terms describe the record.

    A misfit counts if it is significant by χ² with the degrees of freedom of the terms, and larger than 5 %.
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
"""Minimum number of samples, for five averaging times up to a ninth of the record."""
_SPREADS = (1e-50, 1e50)
"""Range of sample spreads whose fourth powers are finite."""
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
    """Return integer factors, ten per decade, up to a third of the record; shape (k,)."""
    decades = np.log10(samples / _LONGEST)
    spread = 10.0 ** (np.arange(int(decades * _PER_DECADE) + 1) / _PER_DECADE)
    return np.unique(np.round(spread).astype(np.int64))


def analysed(series: Series) -> Allan:
    """Analyse an evenly sampled series.

    Raises
    ------
    UsageError
        If it has too few samples, or their range is zero or not finite.
    """
    # the matrices are small: BLAS threads would only wait for each other
    with threadpool_limits(limits=1, user_api="blas"):
        return _analysed(series)


def _analysed(series: Series) -> Allan:
    samples = series.values.size
    if samples < LEAST_SAMPLES:
        raise UsageError(f"{series.source}: {samples} samples are too few; expected at least {LEAST_SAMPLES}")
    least, most = float(series.values.min()), float(series.values.max())
    if least == most:
        raise UsageError(f"{series.source}: all {samples} samples are {least:g}; check that the unit was connected")
    if not _SPREADS[0] < most - least < _SPREADS[1]:  # also true if a sample is NaN
        raise UsageError(
            f"{series.source}: its samples lie from {least:g} to {most:g}, which gives no Allan deviation; "
            "check how they were stored"
        )
    factors = averaging_factors(samples)
    tau_s = np.asarray(factors * series.interval_s, dtype=np.float64)
    values = deviation(series.values, factors)
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
