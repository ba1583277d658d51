"""The part of an effect's gain that is due to its freedom: the cost of tuning its parameters.

An effect that fits with any value of its time constant is more credible than one that fits with a single value. The
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
    """Return the cost of an effect's parameters, in twice the log likelihood; at least 0. `place` is its index."""
    effect = fitted.point.effects[place]
    own = [
        index
        for index, number in enumerate(fitted.numbers)
        if number.effect == place and fitted.inverse_information[index, index] > 0.0
    ]
    # correlated numbers, such as an amplitude and a time constant, have less freedom than each alone
    covariance = fitted.covariance[np.ix_(own, own)]
    room = float(np.linalg.slogdet(2.0 * math.pi * covariance)[1]) if own else 0.0
    possible = sum(2.0 * math.log(_possible(fitted.numbers[index], effect)) for index in own)
    cost = max(possible - room, 0.0)
    for parameter in effect.parameters.values():
        if parameter.role == "choice":
            cost += 2.0 * math.log(max(len(parameter.scan), 1))
    return cost


def _possible(number: Free, effect: DescribedEffect) -> float:
    """Return the width of the possible values of a number, in the scale of the fit; for a size, the size itself."""
    parameter, value = effect.parameters[number.name], effect.values[number.name]
    if parameter.role == "phase":
        return _TURN
    if parameter.role == "size":
        return max(abs(value), 1e-300)
    low, high = min(parameter.scan, default=parameter.low), max(parameter.scan, default=parameter.high)
    return 1.0 + math.log(high / low) if parameter.logarithmic else max(high - low, abs(value))
