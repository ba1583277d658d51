"""Noise that grows with the rate: how much, and whether the data demand it.

It is seen in differences of neighbouring samples, which hold nothing of what a model has left out and what changes
slowly; each sample belongs to one difference, so that these are independent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from benchctl_instruments.arrays import BoolArray, FloatArray

_MOST = math.log(100.0**2 - 1.0)
_LEAST = math.log(1e-4)
_STEP = 0.05
_NORMAL_KURTOSIS = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Growing:
    """Noise of variance σ²·(1 + growth·(ω/range)²): the gain over none, the growth, and its logarithm's error."""

    gain: float
    growth: float
    log_error: float

    @property
    def factor(self) -> float:
        """Noise at full rate over noise at rest."""
        return math.sqrt(1.0 + self.growth)


def growing(innovation: FloatArray, counted: BoolArray, share_of_range: FloatArray, known: FloatArray) -> Growing:
    """How much noise grows with the rate, from innovations [σ] of shape (n,) of rows that count.

    `share_of_range` is ω/range; `known` the variance [σ²] that half a difference has beside the noise, which the
    encoder's noise brings: all of shape (n,).
    """
    first = 2 * np.arange(innovation.size // 2)
    first = first[counted[first] & counted[first + 1]]
    half = 0.5 * (innovation[first + 1] - innovation[first]) ** 2
    squared_rate, beside = share_of_range[first] ** 2, known[first]
    if first.size < 100 or float(np.ptp(squared_rate)) < 0.01:
        return Growing(gain=0.0, growth=0.0, log_error=math.inf)

    def deviance(growth: float) -> float:
        shape = 1.0 + growth * squared_rate + beside
        return first.size * math.log(float(np.mean(half / shape))) + float(np.log(shape).sum())

    found = minimize_scalar(lambda log: deviance(math.exp(log)), bounds=(_LEAST, _MOST), method="bounded")
    log = float(found.x)
    low, here, high = (deviance(math.exp(log + k * _STEP)) for k in (-1, 0, 1))
    curvature = max((low - 2.0 * here + high) / _STEP**2, 1e-6)
    shape = half / (1.0 + math.exp(log) * squared_rate + beside)
    kurtosis = float(np.mean(shape**2)) / float(np.mean(shape)) ** 2
    # heavy tails make a variance less certain than normal noise does
    odd = max((kurtosis - 1.0) / (_NORMAL_KURTOSIS - 1.0), 1.0)
    return Growing(gain=(deviance(0.0) - here) / odd, growth=math.exp(log), log_error=math.sqrt(2.0 * odd / curvature))
