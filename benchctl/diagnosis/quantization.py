"""Removal of a coarse converter's steps from the output, if the noise does not smooth them out.

The step size follows from the samples (`faults`). The effect of the steps on a voltage can be computed only with a
prediction that is accurate to a fraction of a step, so this test comes last. A prediction error then shifts the edges
of the steps and moves equal numbers of rows across them in both directions: to first order the errors cancel.
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
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import fit
from benchctl_instruments.physics.effects.adc_nonlinearity import AdcNonlinearity
from benchctl_instruments.physics.effects.effect import DescribedEffect

_OF_THE_STEPS = 0.02
"""Maximum relative deviation of step/period from an integer for a wave to count as a product of the steps."""


def unrounded(problem: PartProblem, chosen: Selection, step_v: float) -> PartProblem | None:
    """Return the problem without the converter's mean rounding if that explains the recording better, else None.

    `step_v` is the detected step, 0 if none was detected. The new search starts from the chosen model; waves whose
    period is an integer fraction of the step are dropped, as the steps themselves cause them.
    """
    if step_v == 0.0 or not isinstance(problem, GyroProblem):
        return None
    fitted = chosen.full
    point = replace(fitted.point, effects=tuple(one for one in fitted.point.effects if not _of_the_steps(one, step_v)))
    other = problem.unrounded(problem.predict(point.baseline, point.effects), step_v)
    everything = np.ones_like(chosen.heldout)
    less = fitted.squares - fit(other, chosen.whitener, point, everything).squares
    return other if less > BEYOND_CHANCE * fitted.deviation**2 else None


def without_the_steps_own(problem: PartProblem, chosen: Selection, step_v: float) -> Selection:
    """Return the selection without waves whose period is an integer fraction of the converter's step.

    Such waves can remain even if the steps are ten times the noise or more.
    """
    effects = chosen.after.point.effects
    own = [key for key, one in zip(keys_of(effects), effects, strict=True) if step_v and _of_the_steps(one, step_v)]
    return reduced(problem, chosen, own) if own else chosen


def _of_the_steps(effect: DescribedEffect, step_v: float) -> bool:
    if not isinstance(effect, AdcNonlinearity):
        return False
    order = step_v / effect.period_v
    return round(order) >= 1 and math.isclose(order, round(order), rel_tol=_OF_THE_STEPS)
