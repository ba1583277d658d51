"""A nonlinearity of static points, as the one number of an open-loop interferometer: U = U0 + (K0/S)·sin(S·ω)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from benchctl.calibration.static_points_fit import FEWEST_RATES, RESTING_DPS, fit_static_points
from benchctl.diagnosis.gyro.points import PointsProblem
from benchctl.diagnosis.result import Estimate, Finding
from benchctl.estimation.problem import Problem

_NONLINEARITY = "rate_nonlinearity"
_SINE = 0.2
"""Of the straight line's misfit: a law that leaves less by its one number more is the interferometer's."""


def with_sine(problem: Problem, findings: Iterable[Finding]) -> Iterator[Finding]:
    """The findings; a nonlinearity of static points that is a sine states its S, too, as `S_rad_per_dps`."""
    for one in findings:
        sine = _sine_of(problem) if one.effect == _NONLINEARITY else None
        yield one if sine is None else replace(one, parameters={**one.parameters, "S_rad_per_dps": sine})


def _sine_of(problem: Problem) -> Estimate | None:
    """S of the points that are fitted; None of samples, and where the law is no sine."""
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
