"""The noise of a recording, and the filter that makes it white.

White noise and a random walk of the bias together are, sample by sample, a moving average of first order of their own
innovations: x_t − x_{t−1} = e_t − (1 − g)·e_{t−1}, with the gain g between 0 (no walk) and 1. What is left when both
data and predictions have passed (1 − B)/(1 − (1 − g)·B) is white, and a constant becomes (1 − g)^t: the level at the
start, which the walk then leaves (Harvey, Forecasting, structural time series models, 1989, sec. 2.4).

The likelihood of a model is that of its innovations: the filter's determinant is one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.signal

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Whitener:
    """Turns a column of data or of a prediction, shape (n,), into one whose noise is white and of one size.

    `walk_gain` is g (0: no walk); `weight` (n,) is the inverse of a row's relative deviation, 0 where it does not
    count.
    """

    walk_gain: float = 0.0
    stretches: tuple[slice, ...]
    interval_s: float
    weight: FloatArray

    def walk_per_sqrt_s(self, innovation: float) -> float:
        """The random walk [unit/√s] that goes with the gain and the deviation of the innovations."""
        return self.walk_gain * innovation / math.sqrt(self.interval_s)

    def white_deviation(self, innovation: float) -> float:
        """Deviation of the white part of a sample from that of its innovation."""
        return innovation * math.sqrt(1.0 - self.walk_gain)

    def __call__(self, column: FloatArray) -> FloatArray:
        """The whitened column, shape (n,)."""
        white = np.empty_like(column)
        for part in self.stretches:
            white[part] = self._innovations(column[part])
        white *= self.weight
        return white

    def _innovations(self, values: FloatArray) -> FloatArray:
        if self.walk_gain == 0.0:
            return values
        innovations: FloatArray = scipy.signal.lfilter([1.0, -1.0], [1.0, self.walk_gain - 1.0], values)
        return innovations
