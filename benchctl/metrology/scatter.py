"""How far overlapping Allan variances of one record scatter, and together, for a noise of a given density.

An Allan variance is the mean square of the rates through a filter, that of averaging time m·τ0 with the gain

    |H(f)|² = 2·sin⁴(π·f·m·τ0) / (m·sin(π·f·τ0))².

The means of squares of two such series of Gaussian noise, over n terms each, have the covariance

    2/(n·τ0) · ∫ |H_i|²·|H_j|²·S² df

for records that are long beside the averaging times. Up to a ninth of the record that is right to a few percent.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

from benchctl.metrology.noise_terms import TERMS, densities

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_NOISES = TERMS.index("R")
_POINTS = 6000
_LOWEST = 0.1
"""Lowest frequency, in units of half the reciprocal of the record."""


class AllanScatter:
    """The covariances for a record of `samples` every `interval_s` and averaging factors of shape (k,).

    A covariance is quadratic in the squared coefficients: what belongs to each pair of terms is computed once.
    """

    def __init__(self, factors: IntArray, samples: int, interval_s: float) -> None:
        highest_hz = 0.5 / interval_s
        edges_hz = np.geomspace(_LOWEST * highest_hz / samples, highest_hz, _POINTS + 1)
        # no averaging time may see all points at the same phase
        inside = np.random.default_rng(0).uniform(size=_POINTS)
        width_hz = np.diff(edges_hz)
        frequency_hz = edges_hz[:-1] + inside * width_hz
        noises = densities(frequency_hz, interval_s).T[:_NOISES]
        phase = (math.pi * interval_s) * frequency_hz[:, None]
        terms = (samples + 1 - 2 * factors).astype(np.float64)
        responses = math.sqrt(2.0) * np.sin(phase * factors) ** 2 / (factors * np.sin(phase))
        # each term of the shorter series meets the longer one's at all lags; both directions of frequency
        scale = 4.0 / (np.maximum.outer(terms, terms) * interval_s)
        self._of_two = np.array(
            [[scale * _products(responses**2, one * other * width_hz) for other in noises] for one in noises]
        )
        averaged = responses * np.sin(phase * terms) / (terms * np.sin(phase))
        # (a + z)² is a² + 2az + z² where a is what a ramp does, and the mean of z over the record is not zero
        tau_s = factors * interval_s
        self._beside_ramp = np.array(
            [4.0 * np.outer(tau_s, tau_s) * _products(averaged, one * width_hz) for one in noises]
        )

    def covariance(self, squares: FloatArray) -> FloatArray:
        """Of the variances over all factors, shape (k, k), for the squared coefficients, shape (5,), as in `TERMS`."""
        noise, ramp = squares[:_NOISES], squares[_NOISES]
        together = np.einsum("t,u,tuij->ij", noise, noise, self._of_two)
        return np.asarray(together + ramp * np.einsum("t,tij->ij", noise, self._beside_ramp))


def interval_of(deviation: FloatArray, freedom: FloatArray) -> FloatArray:
    """The 95 % intervals of deviations of shape (k,) whose squares have χ² with so many degrees of freedom; (k, 2)."""
    quantiles = chdtri(freedom, np.array([0.025, 0.975])[:, None]) / freedom
    return np.asarray((deviation / np.sqrt(quantiles)).T)


def _products(columns: FloatArray, weights: FloatArray) -> FloatArray:
    return np.asarray(columns.T @ (columns * weights[:, None]))
