"""The five noises of which an Allan deviation is taken to be the sum: what each does over an averaging time.

σ²(τ) = 3Q²/τ² + N²/τ + (2 ln 2/π)·B² + K²τ/3 + R²τ²/2

(IEEE Std 952, annex on the Allan variance.) That is of a rate without end in frequency. Of samples every τ0, the noise
of which ends at half their rate, two terms are others over a few samples: a walk has K²τ/3·(1 + τ0²/2τ²), and flicker
is summed from its density.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

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
    """A coefficient's unit, and the factor into it from that of the rates and seconds."""

    name: str
    factor: float


_OF_RATES: Mapping[Term, CoefficientUnit] = {
    "Q": CoefficientUnit("arcsec", 3600.0),
    "N": CoefficientUnit("deg/sqrt(h)", 60.0),
    "B": CoefficientUnit("deg/h", 3600.0),
    "K": CoefficientUnit("deg/h/sqrt(h)", 3600.0 * 60.0),
    "R": CoefficientUnit("deg/h/h", 3600.0 * 3600.0),
}
"""Of rates in deg/s: the units of IEEE Std 952."""

_PER_SECONDS: Mapping[Term, str] = {"Q": "*s", "N": "/sqrt(Hz)", "B": "", "K": "/sqrt(s)", "R": "/s"}


def unit_of(term: Term, rate_unit: str) -> CoefficientUnit:
    """The unit in which a coefficient is stated, of rates in `rate_unit`; of deg/s those of the standard."""
    return _OF_RATES[term] if rate_unit == "deg/s" else CoefficientUnit(f"{rate_unit}{_PER_SECONDS[term]}", 1.0)


def variances(tau_s: FloatArray, interval_s: float) -> FloatArray:
    """What each term of size one adds to σ² at averaging times of shape (k,); shape (k, 5), in the order of `TERMS`."""
    walk = tau_s / 3.0 * (1.0 + 0.5 * (interval_s / tau_s) ** 2)
    flicker = np.array([_flicker(factor) for factor in (tau_s / interval_s).tolist()])
    return np.stack([3.0 / tau_s**2, 1.0 / tau_s, flicker, walk, 0.5 * tau_s**2], axis=1)


_MANY = 50.0
"""Samples over which flicker no longer knows that they are samples."""


@lru_cache(maxsize=4096)
def _flicker(factor: float) -> float:
    """The variance over so many samples of noise of density 1/(2πf) up to half the sampling rate.

    2/(π·m²) · ∫ sin⁴(m·x)/(x·sin²x) dx from 0 to π/2, through the filter of `scatter`; soon 2 ln 2/π.
    """
    if factor > _MANY:
        return 2.0 * math.log(2.0) / math.pi
    x = np.linspace(0.0, 0.5 * math.pi, int(400 * factor) + 400)[1:]
    return float(2.0 / (math.pi * factor**2) * np.trapezoid(np.sin(factor * x) ** 4 / (x * np.sin(x) ** 2), x))


def densities(frequency_hz: FloatArray, interval_s: float) -> FloatArray:
    """Two-sided power density of each term of size one at frequencies of shape (f,), shape (f, 5); unit²/Hz.

    Those of samples, so that they are right up to half the sampling rate; a ramp has none, it is no noise.
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
