"""Sums over bins of a coordinate: piecewise linear functions, and waves that are locked to an angle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.fft
import scipy.sparse

from benchctl_instruments.arrays import ComplexArray, FloatArray

_BINS_A_WAVE = 8


def bin_of(values: FloatArray, edges: FloatArray) -> npt.NDArray[np.int64]:
    """Return the bin of each value, shape (n,), for m+1 increasing edges; values outside go to the outermost bins."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)


def hats(values: FloatArray, knots: FloatArray, factor: FloatArray | None = None) -> scipy.sparse.csr_array:
    """Return hat functions at the knots (k,), times a factor (n,): a sparse matrix (n, k) with two entries per row."""
    left = np.clip(np.searchsorted(knots, values, side="right") - 1, 0, knots.size - 2)
    width = knots[left + 1] - knots[left]
    part = np.clip((values - knots[left]) / np.where(width > 0.0, width, 1.0), 0.0, 1.0)
    return pairs(left, left + 1, part, factor, knots.size)


def pairs(
    left: npt.NDArray[np.integer[Any]],
    right: npt.NDArray[np.integer[Any]],
    part: FloatArray,
    factor: FloatArray | None,
    count: int,
) -> scipy.sparse.csr_array:
    """Return a sparse matrix (n, count): 1 − part in column `left`, part in `right`, times a factor; (n,) each."""
    data, places = np.empty((part.size, 2)), np.empty((part.size, 2), np.int32)
    np.subtract(1.0, part, out=data[:, 0])
    data[:, 1] = part
    if factor is not None:
        data *= factor[:, None]
    places[:, 0], places[:, 1] = left, right
    ends = np.arange(0, 2 * part.size + 1, 2, dtype=np.int32)
    return scipy.sparse.csr_array((data.ravel(), places.ravel(), ends), shape=(part.size, count))


def line_scores(values: FloatArray, angle_deg: FloatArray, highest: int) -> ComplexArray:
    """Return Σ values·e^(i·m·angle) for m from 0 to `highest`, shape (highest+1,); values and angles [deg] (n,).

    Angles are sorted into bins, at least eight per shortest wave, which attenuates it by at most 3 %.
    """
    bins = 1 << math.ceil(math.log2(_BINS_A_WAVE * max(highest, 1)))
    place = np.floor(angle_deg * (bins / 360.0)).astype(np.int64) & (bins - 1)
    spectrum = scipy.fft.rfft(np.bincount(place, values, minlength=bins))[: highest + 1]
    middle = np.exp(1j * np.pi / bins * np.arange(highest + 1))
    return np.asarray(np.conj(spectrum) * middle)
