"""How large the white noise of a smooth signal is."""

from __future__ import annotations

import math

import numpy as np

from benchctl.diagnosis.signals.normal import QUARTILE
from benchctl_instruments.arrays import FloatArray

_THIRD_DIFFERENCE = QUARTILE * math.sqrt(20.0)
"""Median of the absolute third difference of white noise, in its standard deviations."""


def white_noise_of(values: FloatArray) -> float:
    """The standard deviation of the white noise in a smooth signal (n,), from its third differences."""
    return float(np.median(np.abs(np.diff(values, 3)))) / _THIRD_DIFFERENCE
