"""Linear-phase filters for equidistant angles: the angle itself, its rate or its acceleration, up to an edge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.signal import oaconvolve

from benchctl_instruments.arrays import FloatArray

_FEWEST, _REACH_S = 32, 0.256
"""Samples on either side that a rate is made of, and the time that they reach over at least.

A band that is narrow beside the sampling rate asks for more of them: its gain error grows where they are few.
"""

NARROW = (0.1, 0.2, 10.0, 20.0)
WIDE = (0.2, 0.4, 20.0, 40.0)
"""Edges of pass and stop band as shares of the sampling rate, and their limits in Hz."""


def half_of(sample_rate_hz: float) -> int:
    """Samples on either side of a filter's middle."""
    return max(_FEWEST, math.ceil(_REACH_S * sample_rate_hz))


def edges_hz(band: tuple[float, float, float, float], sample_rate_hz: float) -> tuple[float, float]:
    """Where a band's filter begins to fall and where it has fallen."""
    passing, stopping, passing_hz, stopping_hz = band
    return min(passing * sample_rate_hz, passing_hz), min(stopping * sample_rate_hz, stopping_hz)


def filtered(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Values through a filter; beyond the ends they go on with the slope that they end with."""
    return filtered_each([values], kernel)[0]


def filtered_along(stretches: Sequence[slice], values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Values of stretches that follow one another, shape (n,), each stretch through a filter by itself."""
    return np.concatenate([filtered(values[part], kernel) for part in stretches])


def filtered_each(stretches: Sequence[FloatArray], kernel: FloatArray) -> list[FloatArray]:
    """Several stretches through one filter, each as by itself; all in one go, which is the faster for short ones."""
    reach = kernel.size // 2
    long = [_going_on(values, reach) for values in stretches]
    origins = [float(one[0]) for one in long]
    together: FloatArray = oaconvolve(
        np.concatenate([one - origin for one, origin in zip(long, origins, strict=True)]), kernel, mode="valid"
    )
    firsts = np.cumsum([0, *(one.size for one in long)]).tolist()
    level = float(kernel.sum())
    return [
        together[first : first + values.size] + origin * level
        for first, values, origin in zip(firsts, stretches, origins, strict=False)
    ]


def _going_on(values: FloatArray, reach: int) -> FloatArray:
    """Values with `reach` more on either side, turned about the first and the last."""
    size = min(reach, values.size - 1)
    before = 2 * values[0] - values[size:0:-1]
    after = 2 * values[-1] - values[-2 : -2 - size : -1]
    missing = reach - size
    first, last = (before[0], after[-1]) if size else (values[0], values[-1])
    return np.concatenate([np.full(missing, first), before, values, after, np.full(missing, last)])


def transposed(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """The transpose of `filtered`, for values that vanish within a kernel's reach of either end."""
    result: FloatArray = oaconvolve(values, kernel[::-1], mode="same")
    return result


@lru_cache(maxsize=64)
def differentiator(sample_rate_hz: float, passing_hz: float, stopping_hz: float, order: int) -> FloatArray:
    """Least-squares linear-phase filter, shape (2·`half_of` + 1,): d^order/dt^order in the pass band, 0 beyond."""
    k = np.arange(1, half_of(sample_rate_hz) + 1)
    passing = np.linspace(1e-3, passing_hz, 400)
    stopping = np.linspace(stopping_hz, sample_rate_hz / 2, 300)
    frequency = np.concatenate([passing, stopping])
    omega = 2 * np.pi * frequency
    ideal = np.where(frequency <= passing_hz, omega**order, 0.0)
    # what is asked of the pass band is a small relative error
    weight = np.where(frequency <= passing_hz, 1e4 / np.maximum(omega, 3.0) ** order, 6.0 / (2 * np.pi) ** order)
    phase = np.outer(omega / sample_rate_hz, k)
    basis = 2 * np.sin(phase) if order == 1 else np.hstack([np.ones((omega.size, 1)), 2 * np.cos(phase)])
    ideal = -ideal if order == 2 else ideal
    taps, *_ = np.linalg.lstsq(basis * weight[:, None], ideal * weight, rcond=None)
    if order == 1:
        taps /= 2 * np.sum(taps * k) / sample_rate_hz  # exact for a constant rate
        return np.concatenate([taps[::-1], [0.0], -taps])
    kernel = np.concatenate([taps[:0:-1], taps])
    kernel += ((order == 0) - kernel.sum()) / kernel.size  # exact for an angle at rest
    return kernel
