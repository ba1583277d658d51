"""Rows of a residual that stand out alone.

A row is judged by its surroundings, as the residual may still hold physics. It is compared with what a filter, flat
from 0 Hz to the edge of the band of motion, makes of its neighbours: physics goes through, noise and single rows do
not. Jumps, kinks, ringing, the start of a motion and the edge of a hold leave several rows of a size; a spike leaves
one, and the filter's answer to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.ndimage import median_filter

from benchctl.signals.normal import DEVIATION_OF_MEDIAN
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

HALF = 8
"""Rows on either side that a row is told from."""

_BAND, _EXACT = 0.14, 1e5
"""Edge of the filter's band as a share of the sampling rate, and the weight of errors within it against noise."""

_REACH = 20
"""Rows on either side from which the size of the noise is taken."""

_CANDIDATE = 0.5
"""Share of what makes a spike, by a size that the spike itself has spoilt, from which a row is looked at."""

_NEIGHBOUR, _PER_NEIGHBOUR = 3, 0.4
"""Which of the neighbours, from the largest, stands for them, and as how much noise it counts: of sixteen normal values
the third largest is 1.5 deviations."""

_LINE = (1.0, 0.5, 0.0, -0.5)
"""Weights of the nearest four rows on one side in the straight line through them, at the row."""

_AGREE = 0.5
"""Share of a spike's height by which it must stand out from the line on either side; jumps and kinks do from none."""

_ROUNDS = 3
"""Searches, each without the spikes that are known: one hides another nearby."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleRows:
    """Single rows (m,) with their heights (m,), and the size (n,) of the noise that heights hold, in all rows."""

    rows: IntArray
    heights: FloatArray
    size: FloatArray


def single_rows(residual: FloatArray, searched: BoolArray, times: float, floor: float) -> SingleRows:
    """The `searched` rows of a residual, shape (n,), that stand out so many times from the noise, and alone.

    The noise is nowhere taken to be less than `floor`, nor than where it is quiet in the residual itself.
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
    """The rows among these candidates that stand out from noise (`least` or more), neighbours, and either side."""
    offsets = np.concatenate([np.arange(-_REACH, 0), np.arange(1, _REACH + 1)])
    answer = np.zeros(offsets.size)
    answer[np.abs(offsets) <= HALF] = np.concatenate([-_weights()[::-1], -_weights()])
    places = np.clip(rows[:, None] + offsets[None, :], 0, rest.size - 1)
    # what the surroundings show once a spike here is taken out
    others = np.abs(rest[places] - rest[rows, None] * answer[None, :])
    size = np.maximum(DEVIATION_OF_MEDIAN * np.median(others, axis=1), least)
    near = np.sort(others[:, np.abs(offsets) <= HALF], axis=1)[:, -_NEIGHBOUR]
    height = np.abs(rest[rows])
    alone = height > times * np.maximum(size, _PER_NEIGHBOUR * near)
    sides = (_beside(residual, rows, one) * np.sign(rest[rows]) for one in (-1, 1))
    chosen: IntArray = rows[alone & (np.minimum(*sides) > _AGREE * height)]
    return chosen


def _beside(residual: FloatArray, rows: IntArray, side: int) -> FloatArray:
    """How far rows are above the straight line through their neighbours on one side, shape (m,)."""
    near = np.clip(rows[:, None] + side * np.arange(1, len(_LINE) + 1), 0, residual.size - 1)
    beside: FloatArray = residual[rows] - residual[near] @ np.array(_LINE)
    return beside


def _less_neighbours(residual: FloatArray, weights: FloatArray) -> FloatArray:
    """Each row less what its neighbours say, shape (n,)."""
    kernel = np.concatenate([-weights[::-1], [1.0], -weights])
    rest: FloatArray = np.convolve(np.pad(residual, HALF, mode="edge"), kernel, mode="valid")
    return rest


@cache
def _weights() -> FloatArray:
    """Weights of the neighbours on one side, nearest first: least squares of error and noise, exact for a constant."""
    frequency = np.linspace(0.0, _BAND, 200)
    response = 2.0 * np.cos(2.0 * np.pi * np.outer(frequency, np.arange(1, HALF + 1)))
    share = _EXACT / frequency.size
    system = np.ones((HALF + 1, HALF + 1))
    system[:HALF, :HALF] = share * response.T @ response + 2.0 * np.eye(HALF)
    system[HALF, HALF] = 0.0
    found: FloatArray = np.linalg.solve(system, np.append(share * response.sum(axis=0), 0.5))
    return found[:HALF]
