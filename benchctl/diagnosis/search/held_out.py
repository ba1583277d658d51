"""Which steps of a problem choose and fit, and which are kept for the proof."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.problem import Problem

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

_HELD_OUT = 6
"""One step in so many of a kind chooses nothing and fits nothing."""


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
