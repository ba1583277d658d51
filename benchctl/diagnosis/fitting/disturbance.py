"""What disturbs a slow quantity beside its drive: a process with a memory of its own, and white noise of the readings.

A draught is felt as long as a chamber's air remembers it, so what a free simulation leaves is correlated from row to
row even where nothing is missing from the model. It is the hypothesis that every finding competes with; the fit itself
is one of the temperature. A process with a longer memory than the model's air would follow anything that is missing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import scipy.signal

from benchctl.diagnosis.fitting.fit import Fit, fit
from benchctl.diagnosis.fitting.noise import Slow, Whitener
from benchctl.diagnosis.problem import Problem
from benchctl_instruments.arrays import BoolArray, FloatArray

_MEMORIES, _RATIOS = 5, 6
_LEAST_RATIO, _MOST_RATIO = 1e-4, 1e4
_DRAWS = 400
_REFITTED, _ALTERNATED, _SETTLED = 4, 5, 0.5
"""Rounds of a fit beside a disturbance, and how often each follows the other until the likelihood hardly gains."""
_SHORTEST = 2.0
"""Intervals; a shorter memory is not told from white noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """The process beside white noise, minus twice its log likelihood, and the deviation of the white noise."""

    slow: tuple[Slow, ...]
    deviance: float
    white: float


def disturbance_of(problem: Problem, residual: FloatArray, counted: BoolArray, longest_s: float) -> Disturbance:
    """The likeliest disturbance of residuals, shape (n,), in the unit of the problem.

    Rows that are not `counted` (n,) tell nothing of it. White noise is no smaller than the rounding; the memory no
    longer than `longest_s`, or the recording.
    """
    bare = Whitener(interval_s=problem.interval_s, weight=problem.usable.astype(np.float64), time_s=problem.time_s)
    rows = problem.usable & counted
    count = float(np.count_nonzero(rows))
    floor = max(problem.rounding**2, 1e-12 * float(np.mean(residual[rows] ** 2)), 1e-24)

    def tried(slow: tuple[Slow, ...]) -> Disturbance:
        whitener = bare.beside(slow)
        left = float(np.sum(whitener(residual)[rows] ** 2))
        innovation = whitener.innovation**2 if slow else 1.0
        variance = max(left / count / innovation, floor) * innovation
        deviance = count * math.log(variance) + left / variance + whitener.log_determinant
        return Disturbance(slow=slow, deviance=deviance, white=math.sqrt(variance / innovation))

    def at(place: FloatArray) -> Disturbance:
        memory = math.exp(min(max(float(place[0]), math.log(_SHORTEST)), math.log(most)))
        ratio = math.exp(min(max(float(place[1]), math.log(_LEAST_RATIO)), math.log(_MOST_RATIO)))
        return tried((Slow(remembers=math.exp(-1.0 / memory), drive=ratio),))

    lasts_s = float(problem.time_s[-1] - problem.time_s[0])
    most = max(min(longest_s, lasts_s) / problem.interval_s, 2.0 * _SHORTEST)
    grid = [
        np.array([math.log(memory), math.log(ratio)])
        for memory in np.geomspace(_SHORTEST, most, _MEMORIES)
        for ratio in np.geomspace(_LEAST_RATIO, _MOST_RATIO, _RATIOS)
    ]
    first = min(grid, key=lambda place: at(place).deviance)

    def deviance(place: FloatArray) -> float:
        return at(place).deviance

    found = scipy.optimize.fmin(deviance, first, xtol=0.02, ftol=0.1, maxfun=60, disp=False)
    return min(tried(()), at(np.asarray(found)), key=lambda one: one.deviance)


def disturbance_beside(problem: Problem, fitted: Fit) -> Disturbance:
    """The likeliest disturbance beside a fit, on the steps that it was fitted to."""
    longest_s = problem.memory_s(fitted.point.baseline, fitted.point.effects)
    return disturbance_of(problem, fitted.residual, fitted.fitted[problem.step], longest_s)


def deviance_beside(problem: Problem, fitted: Fit) -> float:
    """Minus twice the log likelihood of a fitted model beside its likeliest disturbance, refitted beside that."""
    best = disturbance_beside(problem, fitted)
    for _ in range(_ALTERNATED):
        fitted = fit(problem, fitted.whitener.beside(best.slow), fitted, fitted.fitted, rounds=_REFITTED)
        again = disturbance_beside(problem, fitted)
        if again.deviance > best.deviance - _SETTLED:
            return min(again.deviance, best.deviance)
        best = again
    return best.deviance


def with_disturbance(problem: Problem, fitted: Fit) -> Fit:
    """The fit with the covariance that its numbers have beside the disturbance that it leaves; as it is without one.

    Disturbances of that memory and size are drawn, and what each would move the numbers by is seen.
    """
    if not problem.disturbed:
        return fitted
    found = disturbance_beside(problem, fitted)
    draws = np.random.default_rng(0)
    noise = draws.standard_normal((_DRAWS, fitted.residual.size))
    for process in found.slow:
        pushes = math.sqrt(process.drive) * draws.standard_normal(noise.shape)
        pushes[:, 0] /= math.sqrt(1.0 - process.remembers**2)
        noise += scipy.signal.lfilter([1.0], [1.0, -process.remembers], pushes, axis=1)
    counted = fitted.fitted[problem.step] & problem.usable
    white = fitted.whitener(found.white * noise) * counted
    moved = white @ fitted.derivatives @ fitted.inverse_information
    return replace(fitted, disturbed_covariance=np.atleast_2d(moved.T @ moved / _DRAWS))
