"""A coarse converter's steps taken off the output, where the noise leaves them standing.

How coarse it is shows in the samples (`faults`), what its steps do to a voltage only beside a prediction that is right
to a fraction of one: so that this is asked once everything else has been found. An error of the prediction then moves
the steps' edges, and of half of the rows that cross one each way: to first order it does not come back.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchctl.diagnosis.earth_rate import BEYOND_CHANCE
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.search.select import reduced
from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.fit import fit
from benchctl.estimation.problem import Problem
from benchctl_instruments.physics.effects.adc_nonlinearity import AdcNonlinearity
from benchctl_instruments.physics.effects.effect import DescribedEffect

_OF_THE_STEPS = 0.02
"""How far a wave's period may be from a whole fraction of a step, in parts of it, to be the steps' own."""


def unrounded(problem: Problem, chosen: Selection, step_v: float) -> Problem | None:
    """The problem without the mean rounding of a converter, where that explains the recording better; or None.

    `step_v` is what was found of its steps, 0 for none. What was chosen is where the search begins again then: a wave
    that goes with the output as often as the steps do is their own doing.
    """
    if step_v == 0.0 or not isinstance(problem, GyroProblem):
        return None
    whole = chosen.whole
    point = replace(whole.point, effects=tuple(one for one in whole.point.effects if not _of_the_steps(one, step_v)))
    other = problem.unrounded(problem.predict(point.baseline, point.effects), step_v)
    everything = np.ones_like(chosen.heldout)
    less = whole.squares - fit(other, chosen.whitener, point, everything).squares
    return other if less > BEYOND_CHANCE * whole.deviation**2 else None


def without_the_steps_own(problem: Problem, chosen: Selection, step_v: float) -> Selection:
    """The selection without waves that go with the output as often as a converter's steps do.

    That much can be left of steps that are ten times the noise and more.
    """
    effects = chosen.after.point.effects
    own = [key for key, one in zip(keys_of(effects), effects, strict=True) if step_v and _of_the_steps(one, step_v)]
    return reduced(problem, chosen, own) if own else chosen


def _of_the_steps(effect: DescribedEffect, step_v: float) -> bool:
    if not isinstance(effect, AdcNonlinearity):
        return False
    order = step_v / effect.period_v
    return round(order) >= 1 and math.isclose(order, round(order), rel_tol=_OF_THE_STEPS)
