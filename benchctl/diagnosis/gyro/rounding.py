"""The mean output of a converter whose steps are wider than the noise.

With normal noise of deviation σ before a converter that rounds to multiples of q, the output's mean at a noiseless u
changes from each code to the next like the normal distribution:

    E(u) = q·(m − 1 + Σ Φ((u/q − m − k + 1/2)/(σ/q)), k = 0, 1, 2),    m = floor(u/q)

(Widrow and Kollár, Quantization noise, 2008, ch. 4). If σ is half a step or more, E(u) is u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from benchctl_instruments.arrays import FloatArray

_LEAST, _MOST, _TRIED = 0.02, 0.5, 25
"""Range and number of noise deviations that are tested, in steps; above the largest the steps are smoothed out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rounding:
    """A converter's steps [V] and the deviation of the noise before it [V]."""

    step_v: float
    noise_v: float

    def mean_v(self, volts: FloatArray) -> FloatArray:
        """Return the mean output at noiseless volts, shape (n,)."""
        steps = volts / self.step_v
        code = np.floor(steps)
        steps -= code
        mean = code - 1.0
        for edge in (-0.5, 0.5, 1.5):
            mean += ndtr((steps - edge) * (self.step_v / self.noise_v))
        mean *= self.step_v
        return mean


def rounding_between(predicted: FloatArray, measured: FloatArray, step_v: float) -> Rounding:
    """Return the noise before steps of `step_v` for which predicted volts best fit the measured ones, (n,) each."""

    def squares(rounding: Rounding) -> float:
        left = measured - rounding.mean_v(predicted)
        return float(left @ left)

    tried = (Rounding(step_v=step_v, noise_v=step_v * share) for share in np.geomspace(_LEAST, _MOST, _TRIED).tolist())
    return min(tried, key=squares)
