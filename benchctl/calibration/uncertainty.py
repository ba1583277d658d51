"""Intervals of parameters whose noise is itself only known within limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import stdtr

FloatArray = npt.NDArray[np.float64]


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
        """Central intervals of all parameters, (p,) each; every part is a t distribution of `freedom`."""
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
