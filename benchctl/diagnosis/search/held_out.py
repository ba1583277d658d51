"""Which steps of a problem choose and fit, which are kept for the proof, and when these speak against a model."""

from __future__ import annotations

import math

import numpy as np

from benchctl.estimation.problem import Problem
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

_HELD_OUT = 6
"""One step in so many of a kind chooses nothing and fits nothing."""
_RARE = 3.0
"""Deviations below what it should be by which a gain on held-out steps speaks against a model."""


def held_out_steps(problem: Problem) -> BoolArray:
    """Whole steps, one in six of each kind, that play no part in choosing or fitting; mask of shape (m,)."""
    return np.asarray(dealt(problem) == _HELD_OUT // 2)


def dealt(problem: Problem) -> IntArray:
    """Steps of each kind dealt out in turn, shape (m,)."""
    places: dict[str, int] = {}
    turns = []
    for kind in problem.step_kinds:
        turns.append(places.get(kind, 0) % _HELD_OUT)
        places[kind] = places.get(kind, 0) + 1
    return np.array(turns, dtype=np.int64)


def least_gain(better: FloatArray, worse: FloatArray) -> float:
    """What a model that is right gains on held-out rows but by a rare chance, in twice the log likelihood; at most 0.

    Both are its whitened residual and that of the model without an effect, shape (n,). Where the two predictions differ
    by d, the right one gains D = Σd²/σ² with a deviation of 2·√D.
    """
    differ = worse - better
    expected = np.count_nonzero(better) * float(differ @ differ) / max(float(better @ better), 1e-300)
    return min(expected - _RARE * 2.0 * math.sqrt(expected), 0.0)


def gain_on(better: FloatArray, worse: FloatArray) -> float:
    """By how much twice the log likelihood is larger for the one residual than for the other, shape (n,) each."""
    return np.count_nonzero(better) * math.log(max(float(worse @ worse), 1e-300) / max(float(better @ better), 1e-300))
