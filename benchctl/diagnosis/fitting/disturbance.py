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

_MEMORIES, _RATIOS, _NEAR = 4, 7, 1.5
_LEAST_RATIO, _MOST_RATIO = 1e-4, 1e4
_DRAWS = 400
_REFITTED, _ALTERNATED, _SETTLED = 4, 5, 0.5
"""Rounds of a fit beside a disturbance, and how often each follows the other until the likelihood hardly gains."""
_UNSEEN = 1e-8
"""Share of a derivative that others do not follow, beneath which it is one of them."""
_REFUTED = 3.84
"""Twice the log likelihood by which the air's own memory must do worse than another before 95 % speak against it."""
_PAUSE = 1.5
"""Intervals between two rows, beyond which a run ends."""
_SHORTEST = 2.0
"""Intervals; a shorter memory is not told from white noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """The process beside white noise, with the deviation of the white noise.

    `deviance` is minus twice the log likelihood of the residuals, `restricted` that of what their fit cannot follow.
    """

    slow: tuple[Slow, ...]
    deviance: float
    restricted: float
    white: float


def disturbance_of(problem: Problem, residual: FloatArray, counted: BoolArray, longest_s: float) -> Disturbance:
    """The likeliest disturbance of residuals, shape (n,), in the unit of the problem, to which nothing was fitted.

    Rows that are not `counted` (n,) tell nothing of it. White noise is no smaller than the rounding; the memory no
    longer than `longest_s`, or the recording.
    """
    return _Residuals(problem, residual[None, :], counted).likeliest(longest_s)


def disturbance_beside(problem: Problem, fitted: Fit) -> Disturbance:
    """The likeliest disturbance beside a fit, on the steps that it was fitted to."""
    return _residuals_of(problem, fitted).likeliest(problem.memory_s(fitted.point.baseline, fitted.point.effects))


def deviance_beside(problem: Problem, fitted: Fit) -> float:
    """Minus twice the log likelihood of a fitted model beside its likeliest disturbance, refitted beside that."""
    best = disturbance_beside(problem, fitted)
    for _ in range(_ALTERNATED):
        fitted = fit(problem, fitted.whitener.beside(best.slow), fitted, fitted.fitted, rounds=_REFITTED)
        again = _residuals_of(problem, fitted).beside(best.slow)
        if again.deviance > best.deviance - _SETTLED:
            return min(again.deviance, best.deviance)
        best = disturbance_beside(problem, fitted)
    return best.deviance


def _residuals_of(problem: Problem, fitted: Fit) -> _Residuals:
    columns = np.vstack([fitted.raw_derivatives.T, fitted.residual])
    return _Residuals(problem, columns, fitted.fitted[problem.step])


class _Residuals:
    """Residuals beside which disturbances are tried, with the derivatives of the fit that left them.

    A fit takes up the slowest of a disturbance, so that what it leaves seems to forget sooner than the air does. The
    disturbance is therefore that of what the derivatives cannot follow (Patterson & Thompson, Biometrika 58, 1971).
    """

    def __init__(self, problem: Problem, columns: FloatArray, counted: BoolArray) -> None:
        """Of derivatives and, last, the residual, shape (p + 1, n)."""
        weight = problem.usable.astype(np.float64)
        self._bare = Whitener(interval_s=problem.interval_s, weight=weight, time_s=problem.time_s)
        self._columns, self._rows = columns, problem.usable & counted
        self._count = float(np.count_nonzero(self._rows))
        squares = float(np.mean(columns[-1][self._rows] ** 2))
        self._floor = max(problem.rounding**2, 1e-12 * squares, 1e-24)
        self._lasts_s = float(problem.time_s[-1] - problem.time_s[0])

    def beside(self, slow: tuple[Slow, ...]) -> Disturbance:
        """How likely one disturbance is, with the white noise that goes with it best."""
        whitener = self._bare.beside(slow)
        white = whitener(self._columns)[:, self._rows]
        # the last number is what is left of the residual, the others the determinant of the derivatives' products
        triangle = np.abs(np.diag(np.linalg.qr(white.T, mode="r")))
        least = _UNSEEN * np.linalg.norm(white[:-1], axis=1) + 1e-300
        followed = 2.0 * float(np.log(np.maximum(triangle[:-1], least)).sum())
        left, innovation = float(triangle[-1] ** 2), whitener.innovation**2 if slow else 1.0

        def of(count: float) -> tuple[float, float]:
            variance = max(left / count / innovation, self._floor) * innovation
            return count * math.log(variance) + left / variance + whitener.log_determinant, variance

        restricted, variance = of(self._count - (len(self._columns) - 1))
        return Disturbance(
            slow=slow,
            deviance=of(self._count)[0],
            restricted=restricted + followed,
            white=math.sqrt(variance / innovation),
        )

    def likeliest(self, longest_s: float) -> Disturbance:
        """The air's own, which remembers for `longest_s`, unless one of a shorter memory is likelier by far."""
        most = max(min(longest_s, self._lasts_s) / self._bare.interval_s, 2.0 * _SHORTEST)

        def at(place: FloatArray) -> Disturbance:
            memory = math.exp(min(max(float(place[0]), math.log(_SHORTEST)), math.log(most)))
            ratio = math.exp(min(max(float(place[1]), math.log(_LEAST_RATIO)), math.log(_MOST_RATIO)))
            return self.beside((Slow(remembers=math.exp(-1.0 / memory), drive=ratio),))

        def restricted(place: FloatArray) -> float:
            return at(place).restricted

        ratios = np.log(np.geomspace(_LEAST_RATIO, _MOST_RATIO, _RATIOS)).tolist()
        memories = np.log(np.geomspace(_SHORTEST, most, _MEMORIES)).tolist()
        first = min((np.array([memory, ratio]) for memory in memories for ratio in ratios), key=restricted)
        found = scipy.optimize.fmin(restricted, first, xtol=0.05, ftol=0.2, maxfun=60, disp=False)
        likeliest = min(self.beside(()), at(np.asarray(found)), key=lambda one: one.restricted)
        sizes = (float(found[1]) + np.linspace(-_NEAR, _NEAR, _RATIOS)).tolist()
        own = min((at(np.array([math.log(most), size])) for size in sizes), key=lambda one: one.restricted)
        return own if own.restricted < likeliest.restricted + _REFUTED else likeliest


def with_disturbance(problem: Problem, fitted: Fit) -> Fit:
    """The fit with the covariance that its numbers have beside the disturbance that it leaves; as it is without one.

    Disturbances of that memory and size are drawn, and what each would move the numbers by is seen.
    """
    if not problem.disturbed:
        return fitted
    found = disturbance_beside(problem, fitted)
    draws = np.random.default_rng(0)
    noise = draws.standard_normal((_DRAWS, fitted.residual.size))
    paused = np.flatnonzero(np.diff(problem.time_s) > _PAUSE * problem.interval_s) + 1
    for process in found.slow:
        pushes = math.sqrt(process.drive) * draws.standard_normal(noise.shape)
        for run in np.split(np.arange(noise.shape[1]), paused):  # each begins with the air as it is
            noise[:, run] += scipy.signal.lfilter([1.0], [1.0, -process.remembers], pushes[:, run], axis=1)
    counted = fitted.fitted[problem.step] & problem.usable
    white = fitted.whitener(found.white * noise) * counted
    moved = white @ fitted.derivatives @ fitted.inverse_information
    return replace(fitted, disturbed_covariance=np.atleast_2d(moved.T @ moved / _DRAWS))
