"""Q, N, B, K and R out of an overlapping Allan deviation, each with its interval, or none where the record has none.

The variances over neighbouring averaging times share their samples: they are fitted by generalised least squares, with
the covariance that the noise found so far would give them (`scatter`), and no square below zero (Stark and Parker,
Computational Statistics 10, 1995, which unlike Lawson and Hanson's search ends where a model fits to the last digit).
Because the weights are those of the model, not of the data, what lies low by chance does not weigh more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from benchctl.metrology.noise_terms import TERMS, Term, variances
from benchctl.metrology.scatter import AllanScatter, interval_of

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LONGEST_SHARE = 9
"""An averaging time beyond this part of the record says little: it is shown and not fitted."""
_SHORTEST, _SHARE = 3, 1.0 / 3.0
"""A term shows its slope where it makes so large a part of the variance, over so many samples or more."""
_ROUNDS = 6
"""Each fit takes its weights from the one before."""
_SIGNIFICANT = 3.0
"""So many deviations must a square be above zero; a ramp's is skew, at two one white record in a hundred has one."""
_IMPERFECT = 0.003
"""By so much a variance may miss the model whatever the record's length."""
DIGITS = 1e-12
"""Closer no deviation is computed: so far a variance is known that has no noise at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficient:
    """One term's coefficient, in units of the rate and seconds, with its 95 % interval."""

    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """What a record has of each term; `refused` says why it has none.

    `squares` (5,) are those of all coefficients that describe it best, whether or not they are believed.
    """

    found: Mapping[Term, Coefficient]
    refused: Mapping[Term, str]
    squares: FloatArray

    def modelled(self, tau_s: FloatArray, interval_s: float) -> FloatArray:
        """The variance that the squares make over averaging times of shape (k,)."""
        return variances(tau_s, interval_s) @ self.squares


def terms_of(variance: FloatArray, factors: IntArray, interval_s: float, scatter: AllanScatter) -> Terms:
    """The terms of overlapping Allan variances, shape (k,), over the averaging factors that are fitted.

    `scatter` is that of these factors, and of longer ones behind them.
    """
    columns = variances(np.asarray(factors * interval_s), interval_s)
    # no term grows or falls faster than the square of the averaging time: a variance may be 0, a model's may not
    apart = np.minimum.outer(factors, factors) / np.maximum.outer(factors, factors)
    least = (variance * apart**2).max(axis=1)
    active = list(range(len(TERMS)))
    refused: dict[Term, str] = {}
    squares, covariance = _fitted(columns, variance, least, scatter, active)
    best = squares
    while (weak := _insignificant(squares, covariance, active)) is not None:
        refused[TERMS[weak]] = "not told from zero"
        active.remove(weak)
        squares, covariance = _fitted(columns, variance, least, scatter, active)
    found: dict[Term, Coefficient] = {}
    shown = columns[factors >= _SHORTEST] * squares
    for row, place in enumerate(active):
        # it stays in the fit: it is there, the others must not make up for it
        if (shown[:, place] >= _SHARE * shown.sum(axis=1)).any():
            found[TERMS[place]] = _coefficient(squares[place], covariance[row, row])
        else:
            refused[TERMS[place]] = "its slope lies outside the record, or under the other terms"
    return Terms(found=found, refused=refused, squares=best)


def _fitted(
    columns: FloatArray, variance: FloatArray, least: FloatArray, scatter: AllanScatter, active: list[int]
) -> tuple[FloatArray, FloatArray]:
    """The squares, shape (5,), and the covariance of the active ones; `least` (k,) is what a model cannot be below."""
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
    """The least squares of columns that differ by orders of magnitude; none of shape (k,) below zero."""
    lengths, length = np.linalg.norm(columns, axis=0), np.linalg.norm(wanted)
    found = lsq_linear(columns / lengths, wanted / length, (0.0, np.inf), method="bvls").x
    return np.asarray(found * (length / lengths))


def _insignificant(squares: FloatArray, covariance: FloatArray, active: list[int]) -> int | None:
    """The place of the term that the record tells least from zero; None where it tells all."""
    if not active:
        return None
    significance = squares[active] / np.sqrt(np.diag(covariance))
    weakest = int(np.argmin(significance))
    return active[weakest] if significance[weakest] < _SIGNIFICANT else None


def _coefficient(square: float, variance: float) -> Coefficient:
    value = math.sqrt(square)
    low, high = interval_of(np.array([value]), np.array([2.0 * square**2 / variance]))[0].tolist()
    return Coefficient(value=value, ci95=(low, high))
