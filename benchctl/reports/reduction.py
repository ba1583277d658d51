"""Data reduction for figures: thinning that keeps extremes, and binned means with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray

_MOST_POINTS = 5000
_COLUMNS = 150


@dataclass(frozen=True, slots=True, kw_only=True)
class Bins:
    """Values y in bins of x, without empty bins; all arrays of shape (k,).

    `mean_se` is the standard error of the mean for independent values.
    """

    centre: FloatArray
    largest: FloatArray
    mean: FloatArray
    mean_se: FloatArray


def thinned(x: FloatArray, y: FloatArray) -> IntArray:
    """Return rising indices of the points to draw: every n-th, and highest and lowest y in each of 150 bins of x."""
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y)).astype(np.int64)
    if finite.size <= _MOST_POINTS:
        return finite
    regular = finite[:: -(-finite.size // _MOST_POINTS)]
    column = _column(x[finite], _COLUMNS)
    by_height = np.lexsort((y[finite], column))
    changes = np.flatnonzero(np.diff(column[by_height]))
    extremes = finite[by_height[np.concatenate(([0], changes, changes + 1, [finite.size - 1]))]]
    return np.union1d(regular, extremes)


def binned(x: FloatArray, y: FloatArray, bins: int) -> Bins:
    """Return values in equal bins of x; points that are not finite are left out. Both of shape (n,)."""
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if x.size == 0:
        empty = np.zeros(0)
        return Bins(centre=empty, largest=empty, mean=empty, mean_se=empty)
    column = _column(x, bins)
    counts = np.bincount(column, minlength=bins)
    used = counts > 0
    n = counts[used].astype(np.float64)
    mean = np.bincount(column, y, bins)[used] / n
    spread = np.bincount(column, (y - mean[(np.cumsum(used) - 1)[column]]) ** 2, bins)[used]
    largest = np.zeros(bins)
    np.maximum.at(largest, column, np.abs(y))
    with np.errstate(invalid="ignore", divide="ignore"):
        se = np.sqrt(spread / (n - 1) / n)
    return Bins(centre=np.bincount(column, x, bins)[used] / n, largest=largest[used], mean=mean, mean_se=se)


def spread(values: FloatArray) -> float:
    """Return the largest less the smallest finite value; 0 without any."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def _column(x: FloatArray, columns: int) -> IntArray:
    low, high = float(x.min()), float(x.max())
    width = (high - low) / columns or 1.0
    return np.minimum((x - low) / width, columns - 1).astype(np.int64)
