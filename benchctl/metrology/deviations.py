"""Compute the overlapping Allan deviation of an evenly sampled rate.

It is based on mean squares of second differences of the integrated rate x, which NIST calls phase: x has one point more
than there are samples, and begins at 0. `kernels` has the inner loops.

Source: W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008), section 5.2. The
tests compare with the numbers printed there.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import nullcontext

import numpy as np
from numpy.lib.stride_tricks import as_strided
from threadpoolctl import threadpool_limits

from benchctl.metrology.kernels import Kernels, by_numpy, room
from benchctl.side_by_side import cores, in_order
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

_MANY = 10_000
"""Number of terms above which BLAS sums squares on several threads, which then wait for each other and for ours."""
_NUMBA_PAYS = 2_000_000_000
"""Number of differences above which numba is faster, although its import takes half a second."""


def deviation(rates: FloatArray, factors: IntArray) -> FloatArray:
    """Compute the deviations (k,) of rates of shape (n,) over `factors` samples each, in the unit of the rates.

    NaN if the record is too short for a factor. Uses all cores, and as much additional memory as the rates take.

    Raises
    ------
    UsageError
        If a rate is not finite, there are fewer than three rates, or a factor is below 1.
    """
    if factors.size and int(factors.min()) < 1:
        raise UsageError(f"expected averaging factors of at least 1, got {int(factors.min())}")
    kernels = kernels_for(rates.size * factors.size)
    phase = integrated(rates, kernels)
    terms = phase.size - 2 * factors
    with threadpool_limits(limits=1, user_api="blas") if phase.size > _MANY else nullcontext():
        sums = sums_of_squares(phase, factors, kernels)
    return np.asarray(np.sqrt(np.where(terms > 0, sums, np.nan) / (2.0 * np.maximum(terms, 1) * factors**2.0)))


def kernels_for(differences: int) -> Kernels:
    """Return the kernels that are faster for this number of differences, all lags together."""
    loaded = sys.modules.get("numba") is not None
    return compiled() if loaded or differences >= _NUMBA_PAYS else by_numpy()


def compiled() -> Kernels:
    """Return numba's kernels, compiled once and cached on disk; numpy's if numba or a writable cache is missing.

    Both give the same digits except the last one or two.
    """
    try:
        from benchctl.metrology import kernels_numba
    except (ImportError, RuntimeError):
        return by_numpy()
    return Kernels(running_sums=kernels_numba.running_sums, squares=kernels_numba.squares)


_ROWS = 2
"""Rows of a core's piece, each summed separately: compiled code processes two as fast as one."""
_SPAN = 1 << 19
"""Number of samples in a row."""


def integrated(rates: FloatArray, kernels: Kernels) -> FloatArray:
    """Integrate rates of shape (n,), in units of the sampling interval, from 0 on; shape (n + 1,).

    The mean, which cancels in every difference, is subtracted first, so that a sum of 10⁸ samples keeps its precision.

    Raises
    ------
    UsageError
        If a rate is not finite, or there are fewer than three.
    """
    if rates.ndim != 1 or rates.size < 3 or not np.isfinite(mean := _phase_mean(rates)):
        raise UsageError(f"expected at least 3 finite rates in a row, got {rates.size} of shape {rates.shape}")
    phase = room(rates.size + 1)
    phase[0] = 0.0
    sums = phase[1:]
    spans = [slice(begin, begin + _SPAN) for begin in range(0, rates.size, _SPAN)]
    even = rates.size // (_ROWS * _SPAN) * _ROWS
    pieces = [spans[k : k + _ROWS] for k in range(0, even, _ROWS)] + [[span] for span in spans[even:]]
    workers = min(cores(), len(pieces))

    def added_up(piece: list[slice]) -> FloatArray:
        part = slice(piece[0].start, piece[-1].stop)
        rows = (len(piece), -1)
        return kernels.running_sums(rates[part].reshape(rows), mean, sums[part].reshape(rows))

    def lifted(span: slice, by: float) -> None:
        sums[span] += by

    ends = np.cumsum(np.concatenate(list(in_order(added_up, pieces, workers))))
    lifts = zip(spans[1:], ends.tolist(), strict=False)
    for _ in in_order(lambda lift: lifted(*lift), lifts, workers):
        pass
    return phase


def _phase_mean(rates: FloatArray) -> float:
    """Mean of the rates; not finite if a rate is not."""
    with np.errstate(invalid="ignore", over="ignore"):
        return float(rates.mean())


_SHORT = 1 << 13
"""The longest of the short lags, in samples."""
_DIFFERENCES_SPAN = 1 << 20
"""Number of points in a row of a core's piece."""
_COLUMNS = 1 << 17
"""Number of points in a piece that consists of columns."""
_NARROWEST = 1 << 6
"""Minimum number of columns of a piece; a multiple of 8, so that all rows have the same cache-line alignment."""


def sums_of_squares(phase: FloatArray, lags: IntArray, kernels: Kernels) -> FloatArray:
    """Return the sums of squares, shape (k,), of all second differences of a phase (n,) over lags (k,).

    0 if there is no difference. The kernels work piece by piece, so that a piece stays in a core's cache, and several
    cores process one piece each; the number of cores does not change the sums. For short lags a piece is a run of
    points. Points a long lag apart do not share a cache: then the phase is arranged in rows as long as the lag, and a
    piece is a copy of some columns. Lags that are multiples of one, as in an octave or decade grid, share the pieces,
    so that the record is read from memory once for all of them.
    """
    found = dict.fromkeys(lags.tolist(), 0.0)
    short = np.array(sorted(lag for lag in found if lag <= _SHORT), dtype=np.int64)
    workers = min(cores(), math.ceil(phase.size / _DIFFERENCES_SPAN))

    def of_points(begin: int) -> tuple[IntArray, FloatArray]:
        return short, kernels.squares(phase, short, begin, min(begin + _DIFFERENCES_SPAN, phase.size))

    def of_columns(piece: tuple[int, IntArray, slice]) -> tuple[IntArray, FloatArray]:
        base, multiples, columns = piece
        points = _copied(phase, base, columns)
        lags = multiples * points.shape[1]
        return multiples * base, kernels.squares(points.reshape(-1), lags, 0, points.size)

    pieces = _pieces(phase.size, sorted(lag for lag in found if _SHORT < lag < phase.size))
    for done in (
        in_order(of_points, range(0, phase.size, _DIFFERENCES_SPAN), workers),
        in_order(of_columns, pieces, workers),
    ):
        for over, sums in done:
            for lag, of_lag in zip(over.tolist(), sums.tolist(), strict=True):
                found[lag] += of_lag
    return np.array([found[lag] for lag in lags.tolist()])


def _pieces(points: int, lags: list[int]) -> Iterator[tuple[int, IntArray, slice]]:
    """Yield the length of a row, the lags in multiples of it, and columns that have the same number of rows."""
    while lags:
        base = lags[0]
        multiples = np.array([lag // base for lag in lags if lag % base == 0])
        rows, longer = divmod(points, base)
        width = max(_COLUMNS // (rows + 1) // 8 * 8, _NARROWEST)
        for first, last in ((0, longer), (longer, base)):
            for begin in range(first, last, width):
                yield base, multiples, slice(begin, min(begin + width, last))
        lags = [lag for lag in lags if lag % base]


def _copied(phase: FloatArray, base: int, columns: slice) -> FloatArray:
    """Copy columns of a phase that is arranged in rows of `base` points; shape (rows, columns)."""
    (step,) = phase.strides
    rows = (phase.size - columns.start - 1) // base + 1
    shape = rows, columns.stop - columns.start
    copied = room(shape[0] * shape[1]).reshape(shape)
    copied[:] = as_strided(phase[columns.start :], shape, (base * step, step), writeable=False)
    return copied
