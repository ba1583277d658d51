"""How many terms the fitted runs can carry: what they cannot tell apart must not be asked of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.calibration.reduce import ReducedStep
from benchctl.calibration.stage_one import group_by_temperature

_REST_DPS = 0.5
_APART_DPS = 1.0
_TERMS_IN_MOTION = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Carries:
    """`rate_terms`: terms in ω, beside scale factor and bias, that one temperature's rates can tell.

    `scale_temperatures`: temperatures with two rates or a motion, which tell a scale factor; `bias_temperatures`: those
    that tell a bias, by the same or by rest.
    """

    rate_terms: int
    scale_temperatures: int
    bias_temperatures: int


def what_it_carries(steps: Sequence[ReducedStep]) -> Carries:
    """Count what these runs can tell; a motion passes through as many rates as any law has terms."""
    rate_terms, scales, biases = 0, 0, 0
    for group in group_by_temperature(np.array([step.mean_temperature_c for step in steps])):
        own = [steps[i] for i in group]
        rates = np.array([float(np.mean(step.rate_dps)) for step in own if step.kind != "motion"])
        moving = rates.size < len(own)
        two_rates = rates.size > 0 and float(np.ptp(rates)) > _APART_DPS
        scales += moving or two_rates
        biases += moving or two_rates or bool(np.any(np.abs(rates) < _REST_DPS))
        if moving:
            rate_terms = _TERMS_IN_MOTION
        elif two_rates:
            signed = np.unique(np.round(rates))
            magnitudes = np.unique(np.abs(signed[signed != 0]))
            rate_terms = max(rate_terms, min(magnitudes.size - 1, signed.size - 2))
    return Carries(rate_terms=max(rate_terms, 0), scale_temperatures=scales, bias_temperatures=biases)
