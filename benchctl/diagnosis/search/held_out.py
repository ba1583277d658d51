"""Steps held out for validation, and when they contradict a model."""

from __future__ import annotations

import math

import numpy as np

from benchctl.diagnosis.stepped import PartProblem
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

_HELD_OUT = 6
"""One step in so many of a kind is held out: it is used neither for selection nor for fitting."""
_RARE = 3.0
"""Number of deviations below its expected value at which a gain on held-out steps contradicts a model."""


def held_out_steps(problem: PartProblem) -> BoolArray:
    """Return a mask, shape (m,), of the steps, one in six of each kind, held out from selection and fitting."""
    return np.asarray(dealt(problem) == _HELD_OUT // 2)


def dealt(problem: PartProblem) -> IntArray:
    """Return fold numbers of the steps, assigned in turn within each kind, shape (m,)."""
    places: dict[str, int] = {}
    turns = []
    for kind in problem.step_kinds:
        turns.append(places.get(kind, 0) % _HELD_OUT)
        places[kind] = places.get(kind, 0) + 1
    return np.array(turns, dtype=np.int64)


def least_gain(better: FloatArray, worse: FloatArray) -> float:
    """Return the least gain in twice the log likelihood, at most 0, that a correct model has on held-out rows.

    A smaller gain is very unlikely. The arguments are the whitened residuals with and without an effect, shape (n,). If
    the two predictions differ by d, the correct one gains D = Σd²/σ² with a deviation of 2·√D.
    """
    differ = worse - better
    expected = np.count_nonzero(better) * float(differ @ differ) / max(float(better @ better), 1e-300)
    return min(expected - _RARE * 2.0 * math.sqrt(expected), 0.0)


def gain_on(better: FloatArray, worse: FloatArray) -> float:
    """Return how much twice the log likelihood is larger for the first residual than for the second, (n,) each."""
    return np.count_nonzero(better) * math.log(max(float(worse @ worse), 1e-300) / max(float(better @ better), 1e-300))
