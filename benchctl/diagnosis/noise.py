"""The noise of a recording, and the filter that makes it white.

White noise and a random walk of the bias together are, sample by sample, a moving average of first order of their own
innovations: x_t − x_{t−1} = e_t − (1 − g)·e_{t−1}, with the gain g between 0 (no walk) and 1. What is left when both
data and predictions have passed (1 − B)/(1 − (1 − g)·B) is white, and a constant becomes (1 − g)^t: the level at the
start, which the walk then leaves (Harvey, Forecasting, structural time series models, 1989, sec. 2.4). Flicker of the
bias is whitened by a ladder of poles and zeros, two an octave, whose gain rises as the square root of the frequency.

The likelihood of a model is that of its innovations: the filter's determinant is one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.signal

FloatArray = npt.NDArray[np.float64]

_RUNGS_AN_OCTAVE = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseModel:
    """What is known of the noise.

    `walk_gain` is g (0: no walk); `flicker_corner_hz` where flicker and white noise are equal (0: none);
    `rate_factor` by how much the white noise is larger at the rated range than at rest.
    """

    walk_gain: float = 0.0
    flicker_corner_hz: float = 0.0
    rate_factor: float = 1.0

    def walk_per_sqrt_s(self, white: float, interval_s: float) -> float:
        """The random walk [unit/√s] that goes with the gain and the deviation of the innovations."""
        return self.walk_gain * white / math.sqrt(interval_s)

    def white_deviation(self, innovation: float) -> float:
        """Deviation of the white part of a sample from that of its innovation."""
        return innovation * math.sqrt(1.0 - self.walk_gain)


@dataclass(frozen=True, slots=True, kw_only=True)
class Whitener:
    """Turns a column of data or of a prediction, shape (n,), into one whose noise is white and of one size.

    `weight` (n,) is the inverse of a row's relative deviation, 0 where it does not count.
    """

    model: NoiseModel
    stretches: tuple[slice, ...]
    interval_s: float
    weight: FloatArray

    def __call__(self, column: FloatArray) -> FloatArray:
        """The whitened column, shape (n,)."""
        white = np.empty_like(column)
        for part in self.stretches:
            white[part] = self._one(column[part])
        white *= self.weight
        return white

    def _one(self, values: FloatArray) -> FloatArray:
        if self.model.walk_gain > 0.0:
            left = 1.0 - self.model.walk_gain
            values = scipy.signal.lfilter([1.0, -1.0], [1.0, -left], values)
        if self.model.flicker_corner_hz > 0.0:
            duration_s = self.interval_s * values.size
            values = scipy.signal.sosfilt(_ladder(self.model.flicker_corner_hz, duration_s, self.interval_s), values)
        return values

    @property
    def free_levels(self) -> FloatArray | None:
        """How a stretch's own level looks when whitened, shape (n,); None where the level is one for all.

        A bias that wanders has, after a gap, another level than before.
        """
        if self.model.walk_gain == 0.0 and self.model.flicker_corner_hz == 0.0:
            return None
        return self(np.ones_like(self.weight)) if len(self.stretches) > 1 else None


def _ladder(corner_hz: float, duration_s: float, interval_s: float) -> FloatArray:
    """Second-order sections whose gain is that of √(f/(f + corner)) between 1/duration and half the sampling rate."""
    lowest_hz = 0.2 / duration_s
    octaves = max(1.0, math.log2(corner_hz / lowest_hz))
    rungs = max(2, math.ceil(octaves * _RUNGS_AN_OCTAVE))
    ratio = (corner_hz / lowest_hz) ** (1.0 / rungs)
    zeros_hz = lowest_hz * ratio ** (np.arange(rungs) + 0.25)
    poles_hz = zeros_hz * math.sqrt(ratio)
    zeros = np.exp(-2 * np.pi * zeros_hz * interval_s)
    poles = np.exp(-2 * np.pi * poles_hz * interval_s)
    sections: FloatArray = scipy.signal.zpk2sos(zeros, poles, 1.0)
    return sections
