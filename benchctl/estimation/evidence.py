"""How much of an effect's gain is owed to its freedom: what its parameters had to be tuned to, over what they could be.

An effect that fits with any value of its time constant deserves more belief than one that fits with a single one. The
evidence of a model is its likelihood times, for each parameter, the width that the data leave over the width that was
possible (Laplace's approximation; MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

import math

import numpy as np

from benchctl.estimation.fit import Fit, Free
from benchctl_instruments.physics.effects.effect import DescribedEffect

_TURN = 360.0


def occam_factor(fitted: Fit, place: int) -> float:
    """What the parameters of the effect at a place of the model cost, in twice the log likelihood; 0 or more."""
    effect = fitted.point.effects[place]
    own = [
        index
        for index, number in enumerate(fitted.numbers)
        if number.effect == place and fitted.inverse_information[index, index] > 0.0
    ]
    # numbers that the data hold together, an amplitude and a time constant say, leave less room than each alone
    covariance = fitted.covariance[np.ix_(own, own)]
    room = float(np.linalg.slogdet(2.0 * math.pi * covariance)[1]) if own else 0.0
    possible = sum(2.0 * math.log(_possible(fitted.numbers[index], effect)) for index in own)
    cost = max(possible - room, 0.0)
    for parameter in effect.parameters.values():
        if parameter.role == "choice":
            cost += 2.0 * math.log(max(len(parameter.scan), 1))
    return cost


def _possible(number: Free, effect: DescribedEffect) -> float:
    """The width of what a number could be, in the scale in which it is moved; of a size, its own."""
    parameter, value = effect.parameters[number.name], effect.values[number.name]
    if parameter.role == "phase":
        return _TURN
    if parameter.role == "size":
        return max(abs(value), 1e-300)
    low, high = min(parameter.scan, default=parameter.low), max(parameter.scan, default=parameter.high)
    return 1.0 + math.log(high / low) if parameter.logarithmic else max(high - low, abs(value))
