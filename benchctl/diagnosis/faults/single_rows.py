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
import numpy.typing as npt
from scipy.ndimage import median_filter

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

HALF = 8
"""Rows on either side that a row is told from."""

_BAND, _EXACT = 0.14, 1e5
_BLIND_BAND, _BLIND_EXACT = 0.08, 1e4
"""Edge of a filter's band as a share of the sampling rate, and the weight of errors within it against noise."""

_REACH = 20
"""Rows on either side from which the size of the noise is taken."""

_CANDIDATE = 0.5
"""Share of what makes a spike, by a size that the spike itself has spoilt, from which a row is looked at."""

_NEIGHBOUR, _PER_NEIGHBOUR = 3, 0.4
"""Which of the neighbours, from the largest, stands for them, and as how much noise it counts: of sixteen normal values
the third largest is 1.5 deviations."""

_AGREE = 0.5
"""Share by which a spike may differ if a kink of the residual (a fold, a limit) is allowed for."""

_ROUNDS = 3
"""Searches, each without the spikes that are known: one hides another nearby."""

_MAD = 1.4826


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
        size = _MAD * median_filter(np.abs(rest), 2 * _REACH + 1, mode="nearest")
        least = max(float(np.quantile(size, 0.1)), floor)
        size = np.maximum(size, least)
        candidates = np.flatnonzero(np.abs(rest) > _CANDIDATE * times * size)
        rows = _alone(rest, _less_neighbours(clean, _blind_weights()), candidates, times, least)
        rows = rows[searched[rows]]
        if rows.size == 0:
            break
        heights[rows] += rest[rows]
        clean[rows] -= rest[rows]
    rows = np.flatnonzero(heights)
    return SingleRows(rows=rows, heights=heights[rows], size=size)


def _alone(rest: FloatArray, blind: FloatArray, rows: IntArray, times: float, least: float) -> IntArray:
    """The rows among these candidates that stand out from noise (`least` or more) and neighbours, and are no kinks."""
    offsets = np.concatenate([np.arange(-_REACH, 0), np.arange(1, _REACH + 1)])
    answer = np.zeros(offsets.size)
    answer[np.abs(offsets) <= HALF] = np.concatenate([-_weights()[::-1], -_weights()])
    places = np.clip(rows[:, None] + offsets[None, :], 0, rest.size - 1)
    # what the surroundings show once a spike here is taken out
    others = np.abs(rest[places] - rest[rows, None] * answer[None, :])
    size = np.maximum(_MAD * np.median(others, axis=1), least)
    near = np.sort(others[:, np.abs(offsets) <= HALF], axis=1)[:, -_NEIGHBOUR]
    height = np.abs(rest[rows])
    alone = height > times * np.maximum(size, _PER_NEIGHBOUR * near)
    sharp = np.abs(blind[rows] - rest[rows]) < _AGREE * height
    chosen: IntArray = rows[alone & sharp]
    return chosen


def _less_neighbours(residual: FloatArray, weights: FloatArray) -> FloatArray:
    """Each row less what its neighbours say, shape (n,)."""
    kernel = np.concatenate([-weights[::-1], [1.0], -weights])
    rest: FloatArray = np.convolve(np.pad(residual, HALF, mode="edge"), kernel, mode="valid")
    return rest


@cache
def _weights() -> FloatArray:
    """Weights of the neighbours on one side, nearest first; they are exact for a constant."""
    return _constrained(_BAND, _EXACT, np.ones((1, HALF)), np.array([0.5]))


@cache
def _blind_weights() -> FloatArray:
    """The same, with no answer to a kink at the row."""
    exactly = np.vstack([np.ones(HALF), np.arange(1.0, HALF + 1.0)])
    return _constrained(_BLIND_BAND, _BLIND_EXACT, exactly, np.array([0.5, 0.0]))


def _constrained(band: float, weight: float, exactly: FloatArray, wanted: FloatArray) -> FloatArray:
    """Weights h, least squares of weighted error and noise, with exactly·h = wanted, shapes (c, HALF) and (c,)."""
    frequency = np.linspace(0.0, band, 200)
    response = 2.0 * np.cos(2.0 * np.pi * np.outer(frequency, np.arange(1, HALF + 1)))
    normal = weight / frequency.size * response.T @ response + 2.0 * np.eye(HALF)
    plain = weight / frequency.size * response.sum(axis=0)
    count = wanted.size
    system = np.block([[normal, exactly.T], [exactly, np.zeros((count, count))]])
    found: FloatArray = np.linalg.solve(system, np.concatenate([plain, wanted]))
    return found[:HALF]
