"""A nonlinearity of static points as the single parameter of an open-loop interferometer: U = U0 + (K0/S)·sin(S·ω)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from benchctl.calibration.static_points_fit import FEWEST_RATES, RESTING_DPS, fit_static_points
from benchctl.diagnosis.gyro.points import PointsProblem
from benchctl.diagnosis.result import Estimate, Finding
from benchctl.diagnosis.stepped import PartProblem

_NONLINEARITY = "rate_nonlinearity"
_SINE = 0.2
"""Maximum misfit relative to the straight line for the interferometer's law to be accepted."""


def with_sine(problem: PartProblem, findings: Iterable[Finding]) -> Iterator[Finding]:
    """Yield the findings; a sine-shaped nonlinearity of static points also states its S as `S_rad_per_dps`."""
    for one in findings:
        sine = _sine_of(problem) if one.effect == _NONLINEARITY else None
        yield one if sine is None else replace(one, parameters={**one.parameters, "S_rad_per_dps": sine})


def _sine_of(problem: PartProblem) -> Estimate | None:
    """Return S of the fitted points; None for samples, or if the law is not a sine."""
    if not isinstance(problem, PointsProblem):
        return None
    rate, mean = problem.following
    if np.unique(rate[np.abs(rate) > RESTING_DPS]).size < FEWEST_RATES:
        return None
    law = fit_static_points(rate, mean).rotating
    if law.sine.rms_dps > _SINE * law.line.rms_dps:
        return None
    low, high = law.S_ci95
    return Estimate(value=law.S_rad_per_dps, low=low, high=high, unit="rad (degree/s)-1")
