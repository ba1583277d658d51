"""Coverage factors from degrees of freedom, and intervals of parameters whose noise is only known within limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri, stdtr, stdtrit

from benchctl_instruments.arrays import FloatArray

K = 2.0
LEVEL = math.erf(K / math.sqrt(2.0))
"""The level of every expanded uncertainty, 95.45 %: that of k = 2 for infinite degrees of freedom."""
_FEWEST_DOF, _MOST_DOF = 1.0, 1e6


def coverage_factor(dof: float, level: float = LEVEL) -> float:
    """Return the quantile of Student's t for a level of confidence (GUM, G.3), for at least 1 degree of freedom.

    >>> round(coverage_factor(math.inf), 2), round(coverage_factor(10), 2), round(coverage_factor(16, 0.99), 2)
    (2.0, 2.28, 2.92)
    """
    if dof >= _MOST_DOF:
        return K if level == LEVEL else float(ndtri(0.5 * (1.0 + level)))
    return float(stdtrit(max(dof, _FEWEST_DOF), 0.5 * (1.0 + level)))


def effective_dof(parts: Iterable[tuple[float, float]]) -> float:
    """Return the effective degrees of freedom of a sum by Welch and Satterthwaite (GUM, G.4.1); infinite if all are.

    `parts` are standard uncertainties in the unit of the result, each with its degrees of freedom.
    """
    known = [(standard, dof) for standard, dof in parts if standard > 0.0]
    # As shares of the sum: fourth powers of small numbers would be zero.
    total = math.hypot(*(standard for standard, _ in known))
    weighed = math.fsum((standard / total) ** 4 / dof for standard, dof in known)
    return 1.0 / weighed if weighed > 0.0 else math.inf


def dof_of_factor(factor: float) -> float:
    """Return the degrees of freedom with this coverage factor; infinite for 2 and less."""
    if factor <= coverage_factor(0.5 * _MOST_DOF):
        return math.inf
    if factor >= coverage_factor(_FEWEST_DOF):
        return _FEWEST_DOF
    return float(brentq(lambda dof: coverage_factor(dof) - factor, _FEWEST_DOF, 0.5 * _MOST_DOF, rtol=1e-6))


@dataclass(frozen=True, slots=True, kw_only=True)
class Mixture:
    """Estimates under several likely noises: weights (k,), means (k, p), covariances (k, p, p)."""

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Mean of the mixture, shape (p,)."""
        return np.asarray(self.weights @ self.means)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the mixture, shape (p, p)."""
        apart = self.means - self.mean
        within = np.tensordot(self.weights, self.covariances, axes=1)
        total = within + (apart * self.weights[:, None]).T @ apart
        return np.asarray(0.5 * (total + total.T))

    def interval(self, probability: float, freedom: float) -> tuple[FloatArray, FloatArray]:
        """Return central intervals of all parameters, (p,) each; every component is a t distribution of `freedom`."""
        deviation = np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))
        centre, width = self.mean, np.sqrt(np.diag(self.covariance))

        def below(limit: FloatArray) -> FloatArray:
            return np.asarray(self.weights @ stdtr(freedom, (limit - self.means) / np.maximum(deviation, 1e-300)))

        def quantile(share: float) -> FloatArray:
            low, high = centre - 50 * width, centre + 50 * width
            for _ in range(60):
                middle = 0.5 * (low + high)
                under = below(middle) < share
                low, high = np.where(under, middle, low), np.where(under, high, middle)
            return np.asarray(0.5 * (low + high))

        tail = 0.5 * (1.0 - probability)
        return quantile(tail), quantile(1.0 - tail)


def mixed(mixtures: Sequence[Mixture], weights: Sequence[float]) -> Mixture:
    """Return one mixture of several, weighted with positive weights, which need not add up to 1."""
    shares = np.asarray(weights) / math.fsum(weights)
    return Mixture(
        weights=np.concatenate([share * one.weights for share, one in zip(shares, mixtures, strict=True)]),
        means=np.concatenate([one.means for one in mixtures]),
        covariances=np.concatenate([one.covariances for one in mixtures]),
    )


def dof_of_mixture(weights: FloatArray, variances: Sequence[float]) -> float:
    """Return the degrees of freedom of a variance that has one of several values, (k,) each, with these weights.

    They give Student's t the coverage factor of the mixture of normal distributions at 95.45 %.
    """
    of = np.maximum(np.asarray(variances), 1e-300)[:, None, None]
    mixture = Mixture(weights=weights, means=np.zeros((of.shape[0], 1)), covariances=of)
    half = float(mixture.interval(LEVEL, _MOST_DOF)[1][0])
    return dof_of_factor(half / math.sqrt(float(mixture.covariance[0, 0])))
