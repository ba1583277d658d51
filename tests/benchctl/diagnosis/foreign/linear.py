"""Continuous-time filters on a uniform grid, exact where the input is straight between the points."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import signal

FloatArray = npt.NDArray[np.float64]


def filtered(numerator: list[float], denominator: list[float], values: FloatArray, dt_s: float) -> FloatArray:
    """A filter (polynomials in s) of `values`, which were at rest at their first value before; shape (n,)."""
    num, den, _ = signal.cont2discrete((np.array(numerator), np.array(denominator)), dt_s, method="foh")
    at_rest = values[0] * numerator[-1] / denominator[-1]
    passed = signal.lfilter(np.ravel(num), den, values - values[0])
    return np.asarray(passed + at_rest, dtype=np.float64)


def lagged(values: FloatArray, tau_s: float, dt_s: float) -> FloatArray:
    """A first-order lag of `values`."""
    return filtered([1.0], [tau_s, 1.0], values, dt_s)


def low_pass(values: FloatArray, cutoff_hz: float, order: int, dt_s: float) -> FloatArray:
    """A low-pass of order 1, or a Butterworth one of order 2."""
    w = 2.0 * np.pi * cutoff_hz
    if order == 1:
        return lagged(values, 1.0 / w, dt_s)
    return filtered([w * w], [1.0, np.sqrt(2.0) * w, w * w], values, dt_s)


def base_excited(values: FloatArray, frequency_hz: float, damping: float, dt_s: float) -> FloatArray:
    """The rate on a resonant mount whose base turns with the rate `values`."""
    w = 2.0 * np.pi * frequency_hz
    return filtered([2.0 * damping * w, w * w], [1.0, 2.0 * damping * w, w * w], values, dt_s)


def at_places(values: FloatArray, places: FloatArray) -> FloatArray:
    """`values` between its points, by the cubic through the four around; `places` in points, shape (m,)."""
    k = np.clip(np.floor(places).astype(np.int64), 1, values.size - 3)
    x = places - k
    return (
        -x * (x - 1) * (x - 2) / 6 * values[k - 1]
        + (x + 1) * (x - 1) * (x - 2) / 2 * values[k]
        - (x + 1) * x * (x - 2) / 2 * values[k + 1]
        + (x + 1) * x * (x - 1) / 6 * values[k + 2]
    )
