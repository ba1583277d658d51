"""How much of an effect's gain is owed to its freedom: what its parameters had to be tuned to, over what they could be.

An effect that fits with any value of its time constant deserves more belief than one that fits with a single one. The
evidence of a model is its likelihood times, for each parameter, the width that the data leave over the width that was
possible (Laplace's approximation; MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

import math

import numpy as np

from benchctl.diagnosis.fit import Fit
from instruments.physics.effects.effect import Parameter

_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
_TURN = 360.0


def occam(fitted: Fit, place: int) -> float:
    """What the parameters of the effect at a place of the model cost, in twice the log likelihood; 0 or more."""
    errors = fitted.deviation * np.sqrt(np.maximum(np.diag(fitted.inverse_information), 0.0))
    effect = fitted.point.effects[place]
    cost = 0.0
    for index, number in enumerate(fitted.numbers):
        if number.effect == place and number.parameter is not None and errors[index] > 0.0:
            wide = _possible(number.parameter, effect.values[number.name]) / (_ROOT_TWO_PI * float(errors[index]))
            cost += 2.0 * math.log(max(wide, 1.0))
    for parameter in effect.parameters.values():
        if parameter.role == "choice":
            cost += 2.0 * math.log(max(len(parameter.scan), 1))
    return cost


def _possible(parameter: Parameter, value: float) -> float:
    """The width of what a parameter could be, in the scale in which it is moved; of a size, its own."""
    if parameter.role == "phase":
        return _TURN
    if parameter.role == "size":
        return abs(value)
    low, high = min(parameter.scan, default=parameter.low), max(parameter.scan, default=parameter.high)
    return 1.0 + math.log(high / low) if parameter.logarithmic else max(high - low, abs(value))
