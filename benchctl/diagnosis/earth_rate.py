"""Choice of an assumption that a recording does not state: the natural one, unless the recording contradicts it.

A gyro on a table measures the Earth's rate. If the scale factor depends on the rate, this leaves an even error of a
millionth of full scale, which would be mistaken for an effect. A simulated recording may contain no Earth rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Fit, Point, fit, solve
from benchctl.estimation.noise import Whitener
from benchctl_instruments.arrays import FloatArray

BEYOND_CHANCE = 6.0
"""Required gain in twice the log likelihood of the less natural assumption: odds of twenty to one."""


def other_answer(problem: PartProblem, chosen: Selection) -> PartProblem | None:
    """Return the problem under the other assumption if that explains the recording better or with fewer effects.

    Otherwise return None. The new search starts from the chosen model.
    """
    other = problem.otherwise()
    if other is None:
        return None
    fitted, white = chosen.full, chosen.whitener
    variance = fitted.deviation**2
    moved = white(other.predict(fitted.point.baseline, fitted.point.effects) - fitted.predicted)
    reach = float(moved @ moved) / variance
    if reach < BEYOND_CHANCE:
        return None
    everything = np.ones_like(chosen.heldout)
    for point, allowed in _simpler(chosen, reach):
        if fit(other, white, point, everything).squares < fitted.squares + allowed * variance:
            return other
    return None


def plainly_better(problem: PartProblem, fitted: Fit, white: Whitener) -> PartProblem | None:
    """Return the problem under the other assumption if that explains the recording better with the same model.

    Otherwise return None. All steps are used; the parameters are refitted by one step only, as the assumptions differ
    very little.
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
    """Yield models to test, and the allowed decrease of twice the log likelihood; negative if it must increase."""
    point = chosen.full.point
    yield point, -BEYOND_CHANCE
    for i, one in enumerate(chosen.evidence.values()):
        if one.gain < reach + BEYOND_CHANCE:
            yield replace(point, effects=(*point.effects[:i], *point.effects[i + 1 :])), BEYOND_CHANCE
