"""Single rows of a residual that differ from their neighbours.

A row is compared with its surroundings, because the residual may still contain physical effects. A filter, flat from
0 Hz to the edge of the motion's band, predicts it from its neighbours: physical effects pass, noise and single rows do
not. Jumps, kinks, ringing, the start of a motion and the edge of a hold leave several rows of similar size; a spike
leaves one row and the filter's response to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.ndimage import median_filter

from benchctl.signals.normal import DEVIATION_OF_MEDIAN
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

HALF = 8
"""Rows on either side from which a row is predicted."""

_BAND, _EXACT = 0.14, 1e5
"""Edge of the filter's band as a share of the sampling rate; weight of errors within the band relative to noise."""

_REACH = 20
"""Rows on either side from which the noise level is estimated."""

_CANDIDATE = 0.5
"""Share of the spike threshold above which a row is a candidate; its noise level still contains the spike."""

_NEIGHBOUR, _PER_NEIGHBOUR = 3, 0.4
"""Rank, from the largest, of the neighbour that represents them, and the share of its size that counts as noise: of
sixteen normal values the third largest is 1.5 deviations."""

_LINE = (1.0, 0.5, 0.0, -0.5)
"""Weights of the nearest four rows on one side that extrapolate their straight line to the row."""

_AGREE = 0.5
"""Share of a spike's height by which it must exceed the line on both sides; jumps and kinks exceed only one."""

_ROUNDS = 3
"""Number of searches, each without the known spikes, as one spike can hide another nearby."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleRows:
    """Single rows (m,), their heights (m,), and the noise level (n,) contained in heights, for all rows."""

    rows: IntArray
    heights: FloatArray
    size: FloatArray


def single_rows(residual: FloatArray, searched: BoolArray, times: float, floor: float) -> SingleRows:
    """Return the `searched` rows of a residual, shape (n,), that exceed the noise so many times, without neighbours.

    The noise level is at least `floor` and at least that of quiet parts of the residual.
    """
    clean = residual.copy()
    heights = np.zeros_like(residual)
    size = np.empty_like(residual)
    for _ in range(_ROUNDS):
        rest = _less_neighbours(clean, _weights())
        size = DEVIATION_OF_MEDIAN * median_filter(np.abs(rest), 2 * _REACH + 1, mode="nearest")
        least = max(float(np.quantile(size, 0.1)), floor)
        size = np.maximum(size, least)
        candidates = np.flatnonzero(np.abs(rest) > _CANDIDATE * times * size)
        rows = _alone(clean, rest, candidates, times, least)
        rows = rows[searched[rows]]
        if rows.size == 0:
            break
        heights[rows] += rest[rows]
        clean[rows] -= rest[rows]
    rows = np.flatnonzero(heights)
    return SingleRows(rows=rows, heights=heights[rows], size=size)


def _alone(residual: FloatArray, rest: FloatArray, rows: IntArray, times: float, least: float) -> IntArray:
    """Return the candidates that exceed the noise (`least` or more), their neighbours, and the line on either side."""
    offsets = np.concatenate([np.arange(-_REACH, 0), np.arange(1, _REACH + 1)])
    answer = np.zeros(offsets.size)
    answer[np.abs(offsets) <= HALF] = np.concatenate([-_weights()[::-1], -_weights()])
    places = np.clip(rows[:, None] + offsets[None, :], 0, rest.size - 1)
    # the surroundings with the candidate's spike removed
    others = np.abs(rest[places] - rest[rows, None] * answer[None, :])
    size = np.maximum(DEVIATION_OF_MEDIAN * np.median(others, axis=1), least)
    near = np.sort(others[:, np.abs(offsets) <= HALF], axis=1)[:, -_NEIGHBOUR]
    height = np.abs(rest[rows])
    alone = height > times * np.maximum(size, _PER_NEIGHBOUR * near)
    sides = (_beside(residual, rows, one) * np.sign(rest[rows]) for one in (-1, 1))
    chosen: IntArray = rows[alone & (np.minimum(*sides) > _AGREE * height)]
    return chosen


def _beside(residual: FloatArray, rows: IntArray, side: int) -> FloatArray:
    """Return how far rows are above the straight line through their neighbours on one side, shape (m,)."""
    near = np.clip(rows[:, None] + side * np.arange(1, len(_LINE) + 1), 0, residual.size - 1)
    height: FloatArray = residual[rows] - residual[near] @ np.array(_LINE)
    return height


def _less_neighbours(residual: FloatArray, weights: FloatArray) -> FloatArray:
    """Return each row less the value predicted from its neighbours, shape (n,)."""
    kernel = np.concatenate([-weights[::-1], [1.0], -weights])
    rest: FloatArray = np.convolve(np.pad(residual, HALF, mode="edge"), kernel, mode="valid")
    return rest


@cache
def _weights() -> FloatArray:
    """Return the weights on one side, nearest first: least squares of error and noise, exact for a constant."""
    frequency = np.linspace(0.0, _BAND, 200)
    response = 2.0 * np.cos(2.0 * np.pi * np.outer(frequency, np.arange(1, HALF + 1)))
    share = _EXACT / frequency.size
    system = np.ones((HALF + 1, HALF + 1))
    system[:HALF, :HALF] = share * response.T @ response + 2.0 * np.eye(HALF)
    system[HALF, HALF] = 0.0
    found: FloatArray = np.linalg.solve(system, np.append(share * response.sum(axis=0), 0.5))
    return found[:HALF]
