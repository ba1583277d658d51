"""Exponential settling since the start of the recording."""

from __future__ import annotations

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import Parameter

SETTLING_TIME = Parameter(
    unit="s",
    meaning="time constant with which it settles",
    low=5.0,
    high=36000.0,
    role="shape",
    scan=(30.0, 100.0, 300.0, 900.0, 2700.0),
    logarithmic=True,
)


def left(time_s: FloatArray, start_s: float, tau_s: float) -> FloatArray:
    """Return e^(−t/tau) in a new array of shape (n,), t counted from `start_s`."""
    share = time_s - start_s
    share *= -1.0 / tau_s
    np.exp(share, out=share)
    return share
