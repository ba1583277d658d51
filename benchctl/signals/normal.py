"""Numbers of the normal distribution, and the white noise of a signal by them."""

from __future__ import annotations

import math

import numpy as np

from benchctl_instruments.arrays import FloatArray

Z95 = 1.959964
"""So many deviations on either side hold 95 %."""
QUARTILE = 0.67449
"""So many deviations on either side hold half: the median of what is normal, without its sign."""
DEVIATION_OF_MEDIAN = 1.4826
"""A deviation over the median of what is normal, without its sign."""

_THIRD_DIFFERENCE = QUARTILE * math.sqrt(20.0)
"""Median of the absolute third difference of white noise, in its standard deviations."""


def white_noise_of(values: FloatArray) -> float:
    """The standard deviation of the white noise in a smooth signal (n,), from its third differences."""
    return float(np.median(np.abs(np.diff(values, 3)))) / _THIRD_DIFFERENCE
