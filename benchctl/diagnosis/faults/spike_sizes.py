"""How many spikes there are and how large, from those that stand out of the noise.

Spikes below a limit are not seen. With x ~ N(0, s²), seen if |x| > τ, and S(s) the share of them that is seen over the
limits τ of all rows, the likelihood of m sizes seen in n rows is f^m·Π N(x; s)·exp(−f·n·S(s)): the fraction is
f = m/(n·S), and the scale that which is likeliest with it (a truncated normal distribution).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from benchctl.diagnosis.signals.normal import Z95

FloatArray = npt.NDArray[np.float64]

_SCALES = np.geomspace(0.02, 20.0, 3000)
"""Scales that are weighed, in units of the root of the mean square of what is seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpikeSizes:
    """The likeliest `fraction` of the rows and `scale_v`, each as (value, low, high) with a 95 % interval."""

    fraction: tuple[float, float, float]
    scale_v: tuple[float, float, float]


def spike_sizes(sizes_v: FloatArray, limits_v: FloatArray, rows: int, noise_v: float) -> SpikeSizes:
    """Fraction and scale from the `sizes_v` (m,) of spikes seen in so many `rows`.

    `limits_v` are quantiles of the rows' limits; `noise_v` is the noise that the sizes hold beside the spikes.
    """
    scales = _SCALES * float(np.sqrt(np.mean(sizes_v**2)))
    seen = np.mean(2.0 * ndtr(-limits_v[None, :] / scales[:, None]), axis=1)
    seen = np.maximum(seen, 1e-300)
    likelihood = -sizes_v.size * (np.log(scales) + np.log(seen)) - np.sum(sizes_v**2) / (2.0 * scales**2)
    best = int(np.argmax(likelihood))
    inside = np.flatnonzero(likelihood[best] - likelihood <= Z95**2 / 2.0)
    low, high = scales[inside[0]], scales[inside[-1]]
    # the error of the fraction: chance of how many come, and the unseen share that goes with the scale
    unseen_spread = math.log(seen[inside[-1]] / seen[inside[0]]) / (2.0 * Z95)
    spread = math.exp(Z95 * math.hypot(1.0 / math.sqrt(sizes_v.size), unseen_spread))
    fraction = sizes_v.size / (rows * float(seen[best]))
    without = [math.sqrt(max(one**2 - noise_v**2, (0.1 * one) ** 2)) for one in (scales[best], low, high)]
    return SpikeSizes(
        fraction=(fraction, fraction / spread, fraction * spread),
        scale_v=(without[0], without[1], without[2]),
    )
