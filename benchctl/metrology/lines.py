"""Straight lines through many tries of the same points at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def line(rate_dps: FloatArray, output_v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope [V/(deg/s)] and intercept [V] of the least-squares line of each try, (d,) each, of points (d, n)."""
    x = rate_dps - rate_dps.mean(axis=1, keepdims=True)
    slope = (x * output_v).sum(axis=1) / (x**2).sum(axis=1)
    return slope, output_v.mean(axis=1) - slope * rate_dps.mean(axis=1)


def misfit(rate_dps: FloatArray, output_v: FloatArray) -> FloatArray:
    """What the line through all points leaves [V], shape (d, n)."""
    slope, intercept = line(rate_dps, output_v)
    return np.asarray(output_v - slope[:, None] * rate_dps - intercept[:, None])
