"""Scan over all periods of a wave in the residual that depends only on the output voltage."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import scipy.fft

from benchctl.diagnosis.search.pull import CELLS, Place, Pull, between, peaks, shortest_resolved
from benchctl_instruments.arrays import FloatArray

_MOST_BINS = 1 << 17
_PADDED = 8
_LONGEST_SPANS = 4.0
"""Longest period, as a multiple of the output's span: half of such a wave is nearly a parabola."""

_HIDDEN = 1e-3
"""Share of a wave's power that the present model must not be able to follow; otherwise its gain means nothing."""


def converter_places(pull: Pull, volts: FloatArray, shortest_v: float, count: int) -> list[Place]:
    """Return the periods [V] of the strongest waves sin(2π·U/period), the most promising first.

    `volts` (n,) are the predicted ones, without noise: with measured volts, a row's noise would be in both coordinate
    and residual, and would look like a curvature where the density of rows decreases. The noise shifts a wave's phase
    by much less than a period. The part of a wave that the present model can follow, such as the third power of the
    rate, is not counted as gain. A few constant rates give a few values of the output, which a wave of some short
    period always follows: periods that few values do not resolve are left out.
    """
    low, high = float(volts[pull.rows].min()), float(volts[pull.rows].max())
    span = max(high - low, 1e-300)
    width = max(shortest_v / CELLS, span / _MOST_BINS)
    first = math.floor(low / width)
    bins = math.floor(high / width) - first + 1
    place = np.clip(np.floor(volts / width).astype(np.int64) - first, 0, bins - 1)
    size = scipy.fft.next_fast_len(_PADDED * bins, real=True)
    kept = min(size // 4, math.floor(size * width / shortest_v)) + 1
    turned = np.exp(-2j * np.pi / size * (first + 0.5) * np.arange(2 * kept))

    def spectrum(values: FloatArray, length: int) -> npt.NDArray[np.complex128]:
        transformed = scipy.fft.rfft(np.bincount(place, values, minlength=bins), size)[:length]
        return np.asarray(transformed * turned[: transformed.size])

    score = -spectrum(pull.pull, kept).imag
    information = spectrum(pull.information, 2 * kept - 1).real
    power = 0.5 * (information[0] - information[::2][:kept])
    known = np.stack([-spectrum(pull.of_known(i), kept).imag for i in range(len(pull.fitted.numbers))])
    own = power - np.einsum("ik,ij,jk->k", known, pull.fitted.inverse_information, known)
    lowest = math.ceil(size * width / (_LONGEST_SPANS * span))
    weight = np.bincount(place, pull.information, minlength=bins).astype(np.float64)
    highest = size / shortest_resolved(weight, shortest_v / width)
    usable = (own > _HIDDEN * power) & (np.arange(kept) >= lowest) & (np.arange(kept) <= highest)
    gain = np.where(usable, score**2 / np.where(usable, own, 1.0), 0.0)
    # rate at which a process of one degree of freedom crosses a level, over so many periods (Rice)
    usual = math.sqrt(float(np.average(volts**2, weights=pull.information)))
    places = max(2.0 * usual / shortest_v, 1.0)
    return [
        Place(size * width / between(gain, index), float(gain[index]), places) for index in peaks(gain, count, _PADDED)
    ]
