"""Sums over waves that are locked to an angle, for every whole number of them a turn at once."""

from __future__ import annotations

import math

import numpy as np
import scipy.fft

from benchctl_instruments.arrays import ComplexArray, FloatArray

_BINS_A_WAVE = 8


def line_scores(values: FloatArray, angle_deg: FloatArray, highest: int) -> ComplexArray:
    """Σ values·e^(i·m·angle) for m from 0 to `highest`, shape (highest+1,), from values and angles of shape (n,).

    Angles are put into bins, eight or more to the shortest wave, which dampens it by 3 percent at most.
    """
    bins = 1 << math.ceil(math.log2(_BINS_A_WAVE * max(highest, 1)))
    place = np.floor(angle_deg * (bins / 360.0)).astype(np.int64) & (bins - 1)
    spectrum = scipy.fft.rfft(np.bincount(place, values, minlength=bins))[: highest + 1]
    middle = np.exp(1j * np.pi / bins * np.arange(highest + 1))
    return np.asarray(np.conj(spectrum) * middle)
