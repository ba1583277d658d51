"""Constants of the normal distribution, and an estimate of a signal's white noise that uses them."""

from __future__ import annotations

import math

import numpy as np

from benchctl_instruments.arrays import FloatArray

Z95 = 1.959964
"""95 % of a normal distribution lie within this many standard deviations."""
QUARTILE = 0.67449
"""Half of a normal distribution lies within this many standard deviations: the median of its absolute value."""
DEVIATION_OF_MEDIAN = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute value."""


def white_noise_of(*signals: FloatArray, order: int = 3) -> float:
    """Return the standard deviation of the white noise in smooth signals, each (n,), from differences of this order.

    Differences of white noise of variance one have the variance (2·order over order). 0 if no signal is long enough.
    """
    differences = [np.abs(np.diff(one, order)) for one in signals if one.size > order]
    if not differences:
        return 0.0
    return float(np.median(np.concatenate(differences))) / (QUARTILE * math.sqrt(math.comb(2 * order, order)))
