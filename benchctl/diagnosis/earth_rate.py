"""What a recording does not state: nature's answer is taken, unless the recording itself speaks against it.

A gyro on a table feels the Earth's rate, and where the scale factor bends with the rate that leaves an even trace of a
millionth of full scale, which would be taken for an effect. But a simulation's recording may hold nothing of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.fit import Fit, Point, fit, solve
from benchctl.estimation.noise import Whitener
from benchctl.estimation.problem import Problem
from benchctl_instruments.arrays import FloatArray

BEYOND_CHANCE = 6.0
"""Twice the log likelihood that the less natural answer must gain: odds of twenty to one."""


def other_answer(problem: Problem, chosen: Selection) -> Problem | None:
    """The problem under the other answer, where that explains the recording better, or with one effect less; or None.

    What was chosen is where the search begins again then.
    """
    other = problem.otherwise()
    if other is None:
        return None
    whole, white = chosen.whole, chosen.whitener
    variance = whole.deviation**2
    moved = white(other.predict(whole.point.baseline, whole.point.effects) - whole.predicted)
    reach = float(moved @ moved) / variance
    if reach < BEYOND_CHANCE:
        return None
    everything = np.ones_like(chosen.heldout)
    for point, allowed in _simpler(chosen, reach):
        if fit(other, white, point, everything).squares < whole.squares + allowed * variance:
            return other
    return None


def plainly_better(problem: Problem, fitted: Fit, white: Whitener) -> Problem | None:
    """The problem under the other answer, where that explains the recording better with a model as it is; or None.

    All steps are asked, and the numbers refitted to them by one step: the two answers are so near to each other.
    """
    other = problem.otherwise()
    if other is None:
        return None
    moved = white(other.predict(fitted.point.baseline, fitted.point.effects) - fitted.predicted)
    information, gradient, squares, _ = fitted.products.of(np.ones_like(fitted.fitted))

    def left(gradient: FloatArray, squares: float) -> float:
        return squares - float(gradient @ solve(information, gradient))

    of_other = squares - 2.0 * float(moved @ fitted.white) + float(moved @ moved)
    less = left(gradient, squares) - left(gradient - fitted.derivatives.T @ moved, of_other)
    return other if less > BEYOND_CHANCE * fitted.deviation**2 else None


def _simpler(chosen: Selection, reach: float) -> Iterator[tuple[Point, float]]:
    """Models to try, and by how much twice the log likelihood may fall with each: negative where it must rise."""
    point = chosen.whole.point
    yield point, -BEYOND_CHANCE
    for i, one in enumerate(chosen.evidence.values()):
        if one.gain < reach + BEYOND_CHANCE:
            yield replace(point, effects=(*point.effects[:i], *point.effects[i + 1 :])), BEYOND_CHANCE
