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


def white_noise_of(*signals: FloatArray, order: int = 3) -> float:
    """The standard deviation of the white noise in smooth signals, each (n,), from differences of some order.

    Differences of white noise of variance one have the variance (2·order over order). 0 where no signal is long enough.
    """
    differences = [np.abs(np.diff(one, order)) for one in signals if one.size > order]
    if not differences:
        return 0.0
    return float(np.median(np.concatenate(differences))) / (QUARTILE * math.sqrt(math.comb(2 * order, order)))
