"""What disturbs a slow quantity beside its drive: a process with a memory of its own, and white noise of the readings.

A draught is felt as long as a chamber's air remembers it, so what a free simulation leaves is correlated from row to
row even where nothing is missing from the model. It is the hypothesis that every finding competes with; the fit itself
is one of the temperature. A process with a longer memory than the model's air would follow anything that is missing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.optimize
import scipy.signal

from benchctl.estimation.fit import Fit, fit
from benchctl.estimation.noise import Slow, Whitener
from benchctl.estimation.problem import Problem
from benchctl.recordings.runs import gap_free
from benchctl_instruments.arrays import BoolArray, FloatArray

_MEMORIES = 5
_SIZES = tuple(np.geomspace(1e-4, 1e4, 7).tolist())
"""Drives of a disturbance over the variance of the white noise, among which the likeliest is looked for."""
_DRAWS = 400
_REFITTED, _ALTERNATED, _SETTLED = 4, 5, 0.5
"""Rounds of a fit beside a disturbance, and how often each follows the other until the likelihood hardly gains."""
_ALL_BUT, _HALVED = 0.95, 5
"""Share of disturbances that lead a fit less far astray; how often the way to a likelier model is halved."""
_UNSEEN = 1e-8
"""Share of a derivative that others do not follow, beneath which it is one of them."""
_REFUTED = 3.84
"""Twice the log likelihood by which the air's own memory must do worse than another before 95 % speak against it."""
_STEP = 0.7
"""How far the logarithms of memory and size are moved at first from the likeliest of many."""
_NEGLIGIBLE = 1e-6
"""Share of the variance of what pushes of the air become, below which a process is left away."""
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


def disturbance_of(problem: Problem, residual: FloatArray, baseline: FloatArray, effects: Sequence[Any]) -> Disturbance:
    """The likeliest disturbance of what a model leaves, shape (n,), in the unit of the problem, as if not fitted."""
    pushed = pushed_in(problem, baseline, effects)
    return _Residuals(problem, residual[None, :], np.ones(residual.size, np.bool_)).own(pushed)


def pushed_in(problem: Problem, baseline: FloatArray, effects: Sequence[Any]) -> tuple[Slow, ...]:
    """What pushes of unit power become as a model forgets them."""
    interval_s = problem.interval_s
    return tuple(
        Slow(remembers=math.exp(-rate * interval_s), drive=-power * math.expm1(-2.0 * rate * interval_s) / (2.0 * rate))
        for rate, power in problem.forgetting(baseline, effects)
    )


def disturbance_beside(problem: Problem, fitted: Fit) -> Disturbance:
    """The likeliest disturbance beside a fit, on the steps that it was fitted to."""
    return _residuals_of(problem, fitted).own(_pushed(problem, fitted))


def beside_disturbance(problem: Problem, fitted: Fit) -> Fit:
    """The same model, with what it leaves whitened beside the disturbance that it needs."""
    whitener = fitted.whitener.beside(disturbance_beside(problem, fitted).slow)
    return fit(problem, whitener, fitted, fitted.fitted, rounds=0)


def deviance_near(problem: Problem, nearest: Fit) -> float:
    """Minus twice the log likelihood of a model beside its disturbance, of the likeliest numbers near those of a fit.

    They may miss the measured quantity by so much more as the right ones would, of which the disturbance leads a fit
    astray, in all but one of twenty draws: where weighing the rows moves them farther, something is missing, and what
    changes fast would be followed at the cost of all else. It is the whole likelihood of what is really left: the
    restricted one has lost what the numbers follow, of which every model has another share.
    """
    found = _likeliest(problem, nearest)
    most = nearest.squares + float(np.quantile(_followed(problem, nearest, found), _ALL_BUT))
    moved = nearest
    for _ in range(_ALTERNATED):
        moved = fit(problem, nearest.whitener.beside(found.slow), moved, moved.fitted, rounds=_REFITTED)
        inside = _towards(problem, nearest, moved, most)
        again = _likeliest(problem, inside)
        if again.deviance > found.deviance - _SETTLED or inside.point is not moved.point:
            return min(again.deviance, found.deviance)
        found = again
    return found.deviance


def most_followed(problem: Problem, fitted: Fit) -> float:
    """The most that the numbers of a fit take off the sum of squares of a disturbance, of many that are drawn.

    Each is remembered as long as the air is: what a fit leaves seems to forget sooner.
    """
    found = _residuals_of(problem, fitted).remembered(_pushed(problem, fitted))
    return float(_followed(problem, fitted, found).max())


def _followed(problem: Problem, fitted: Fit, found: Disturbance) -> FloatArray:
    """What the numbers of a fit take off the sum of squares of each drawn disturbance, shape (draws,)."""
    drawn = _drawn(problem, fitted, found)
    return np.asarray(np.einsum("ij,jk,ik->i", drawn, fitted.inverse_information, drawn))


def _towards(problem: Problem, nearest: Fit, moved: Fit, most: float) -> Fit:
    """The model on the way from the nearest to a moved one, as far as its sum of squares is at most so large."""
    there = fit(problem, nearest.whitener, moved, nearest.fitted, rounds=0)
    if there.squares <= most:
        return there
    numbers = nearest.numbers
    begin, end = (one.point.values(numbers) for one in (nearest, moved))

    def at(share: float) -> Fit:
        point = nearest.point.moved(numbers, begin + share * (end - begin))
        return fit(problem, nearest.whitener, point, nearest.fitted, rounds=0)

    low, high = 0.0, 1.0
    for _ in range(_HALVED):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(middle).squares <= most else (low, middle)
    return at(low)


def _drawn(problem: Problem, fitted: Fit, found: Disturbance) -> FloatArray:
    """Products of drawn disturbances with the derivatives of a fit, shape (draws, p)."""
    draws = np.random.default_rng(0)
    noise = draws.standard_normal((_DRAWS, fitted.residual.size))
    for process in found.slow:
        pushes = math.sqrt(process.drive) * draws.standard_normal(noise.shape)
        for run in gap_free(problem.time_s, problem.interval_s):  # each begins with the air as it is
            noise[:, run] += scipy.signal.lfilter([1.0], [1.0, -process.remembers], pushes[:, run], axis=1)
    white = fitted.whitener(found.white * noise) * (fitted.fitted[problem.step] & problem.usable)
    return np.asarray(white @ fitted.derivatives)


def _likeliest(problem: Problem, fitted: Fit) -> Disturbance:
    slowest = max(_pushed(problem, fitted), key=lambda one: one.remembers)
    left = _Residuals(problem, fitted.residual[None, :], fitted.fitted[problem.step])
    return left.likeliest((slowest,), _deviance)


def _deviance(one: Disturbance) -> float:
    return one.deviance


def _restricted(one: Disturbance) -> float:
    return one.restricted


def _pushed(problem: Problem, fitted: Fit) -> tuple[Slow, ...]:
    return pushed_in(problem, fitted.point.baseline, fitted.point.effects)


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
        self._lasts = float(problem.time_s[-1] - problem.time_s[0]) / problem.interval_s

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

    def likeliest(
        self,
        pushed: tuple[Slow, ...],
        key: Callable[[Disturbance], float],
    ) -> Disturbance:
        """That with the least `key`: none, or what comes of the `pushed` processes, forgotten as soon or sooner."""
        most = self._longest(pushed)
        memories = np.geomspace(_SHORTEST, most, _MEMORIES).tolist()
        first = min(itertools.product(memories, _SIZES), key=lambda one: key(self._of(pushed, *one)))

        def at(place: FloatArray) -> Disturbance:
            memory, size = np.exp(np.clip(place, *np.log([[_SHORTEST, _SIZES[0]], [most, _SIZES[-1]]]))).tolist()
            return self._of(pushed, memory, size)

        def missed(place: FloatArray) -> float:
            return key(at(place))

        around = np.log(first) + _STEP * np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, -1.0]])
        found = scipy.optimize.fmin(
            missed, around[0], initial_simplex=around, xtol=0.05, ftol=0.1, maxfun=60, disp=False
        )
        return min(self.beside(()), at(np.asarray(found)), key=key)

    def own(self, pushed: tuple[Slow, ...]) -> Disturbance:
        """By the restricted likelihood what comes of the `pushed` processes, unless another is likelier by far."""
        likeliest, own = self.likeliest(pushed, _restricted), self.remembered(pushed)
        return own if own.restricted < likeliest.restricted + _REFUTED else likeliest

    def remembered(self, pushed: tuple[Slow, ...]) -> Disturbance:
        """By the restricted likelihood what comes of the `pushed` processes, of whatever size."""
        most = self._longest(pushed)
        found = scipy.optimize.minimize_scalar(
            lambda size: self._of(pushed, most, math.exp(size)).restricted,
            bounds=(math.log(_SIZES[0]), math.log(_SIZES[-1])),
            method="bounded",
            options={"xatol": 0.05},
        )
        return self._of(pushed, most, math.exp(found.x))

    def _longest(self, pushed: tuple[Slow, ...]) -> float:
        """For how many rows the slowest of the processes is remembered, at most the whole recording."""
        slowest = max((one.remembers for one in pushed), default=0.0)
        longest = -1.0 / math.log(slowest) if 0.0 < slowest < 1.0 else math.inf * slowest
        return max(min(longest, self._lasts), 2.0 * _SHORTEST)

    def _of(self, pushed: tuple[Slow, ...], memory: float, size: float) -> Disturbance:
        """What comes of the processes where none is remembered for more than `memory` rows."""
        variances = [one.drive / max(1.0 - one.remembers**2, 1.0 / self._lasts) for one in pushed]
        drives: dict[float, float] = {}
        for one, variance in zip(pushed, variances, strict=True):
            if variance > _NEGLIGIBLE * sum(variances):
                remembers = min(max(one.remembers, math.exp(-1.0 / _SHORTEST)), math.exp(-1.0 / memory))
                drives[remembers] = drives.get(remembers, 0.0) + size * one.drive
        whole = sum(one.drive for one in pushed)
        slow = tuple(Slow(remembers=key, drive=drive / whole) for key, drive in drives.items())
        return self.beside(slow)


def with_disturbance(problem: Problem, fitted: Fit) -> Fit:
    """The fit with the covariance that its numbers have beside the disturbance that it leaves; as it is without one.

    Disturbances of that memory and size are drawn, and what each would move the numbers by is seen.
    """
    if not problem.disturbed:
        return fitted
    moved = _drawn(problem, fitted, disturbance_beside(problem, fitted)) @ fitted.inverse_information
    return replace(fitted, disturbed_covariance=np.atleast_2d(moved.T @ moved / _DRAWS))
