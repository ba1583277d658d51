"""Sums of squares of the differences of a phase, each beginning one point after the other, over many lags.

A difference of order two is that of neighbouring averages, one of order three that of two such differences. They are
made and added up piece by piece (`kernels`), so that what is in work stays in a core's cache; several cores take a
piece each. How many there are changes no bit of the sums.

Over short lags a piece is some points in a row. Points that lie a long lag apart are in no cache together: there the
phase is laid in rows of as many points as the lag has, and a piece is some of its columns, copied, in which the points
lie as near as the piece is wide. Lags that are multiples of one, as those of an octave or a decade grid are, share the
pieces: the record comes from memory once for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import as_strided

from benchctl.metrology.kernels import FloatArray, IntArray, Kernels, room
from benchctl.side_by_side import cores, in_order

_SHORT = 1 << 13
"""The longest of the short lags."""
_SPAN = 1 << 20
"""Points in a row of a core's piece."""
_COLUMNS = 1 << 17
"""Points of a piece that is made of columns."""
_NARROWEST = 1 << 6
"""Columns of one at least: where there are thousands of rows, they are in no core's own cache. Always some eights of
them, so that all rows lie alike in the cache's lines."""


def sums_of_squares(phase: FloatArray, lags: IntArray, order: int, kernels: Kernels) -> FloatArray:
    """Of all differences of order 2 or 3, of a phase of shape (n,) over lags of shape (k,); 0 where there is none."""
    found = dict.fromkeys(lags.tolist(), 0.0)
    short = np.array(sorted(lag for lag in found if lag <= _SHORT), dtype=np.int64)
    workers = min(cores(), math.ceil(phase.size / _SPAN))

    def of_points(begin: int) -> tuple[IntArray, FloatArray]:
        return short, kernels.squares(phase, short, order, begin, min(begin + _SPAN, phase.size))

    def of_columns(piece: tuple[int, IntArray, slice]) -> tuple[IntArray, FloatArray]:
        base, multiples, columns = piece
        points = _copied(phase, base, columns)
        lags = multiples * points.shape[1]
        return multiples * base, kernels.squares(points.reshape(-1), lags, order, 0, points.size)

    pieces = _pieces(phase.size, sorted(lag for lag in found if _SHORT < lag < phase.size))
    for done in (in_order(of_points, range(0, phase.size, _SPAN), workers), in_order(of_columns, pieces, workers)):
        for over, sums in done:
            for lag, of_lag in zip(over.tolist(), sums.tolist(), strict=True):
                found[lag] += of_lag
    return np.array([found[lag] for lag in lags.tolist()])


def _pieces(points: int, lags: list[int]) -> Iterator[tuple[int, IntArray, slice]]:
    """Columns, all of which have as many rows; the lag that a row is long; those lags that are multiples of it."""
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
    """Columns of a phase in rows of `base` points, shape (rows, columns)."""
    (step,) = phase.strides
    rows = (phase.size - columns.start - 1) // base + 1
    shape = rows, columns.stop - columns.start
    copied = room(shape[0] * shape[1]).reshape(shape)
    copied[:] = as_strided(phase[columns.start :], shape, (base * step, step), writeable=False)
    return copied
