"""The disturbance of a slow quantity: a correlated process, and the white noise of the readings.

A chamber's air responds to a draught for as long as its time constant, so the residual of a free simulation is
correlated from row to row even if the model is complete. Every finding competes with this hypothesis; the fit itself is
one of the temperature. A process with a longer memory than the model's air would absorb anything that is missing.
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
"""Drives of a disturbance over the variance of the white noise, from which the search for the likeliest starts."""
_DRAWS = 400
_REFITTED, _ALTERNATED, _SETTLED = 4, 5, 0.5
"""Rounds of a fit with a disturbance; how often fit and disturbance alternate, until the likelihood hardly gains."""
_ALL_BUT, _HALVED = 0.95, 5
"""Quantile of the effect of drawn disturbances on a fit; number of halvings of the step to a likelier model."""
_UNSEEN = 1e-8
"""Share of a derivative not explained by the others, below which it counts as linearly dependent."""
_REFUTED = 3.84
"""Twice the log likelihood by which the air's own memory must be less likely to be rejected at 95 % confidence."""
_STEP = 0.7
"""Initial step of the logarithms of memory and size from the likeliest of the grid."""
_NEGLIGIBLE = 1e-6
"""Share of the variance of the air's disturbances, below which a process is left out."""
_SHORTEST = 2.0
"""In sampling intervals; a shorter memory is not distinguishable from white noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """The correlated process, and the standard deviation of the white noise.

    `deviance` is minus twice the log likelihood of the residuals, `restricted` that of the part that their fit cannot
    absorb.
    """

    slow: tuple[Slow, ...]
    deviance: float
    restricted: float
    white: float


def disturbance_of(problem: Problem, residual: FloatArray, baseline: FloatArray, effects: Sequence[Any]) -> Disturbance:
    """Return the likeliest disturbance of a residual, shape (n,), in the unit of the problem, as if not fitted."""
    pushed = pushed_in(problem, baseline, effects)
    return _Residuals(problem, residual[None, :], np.ones(residual.size, np.bool_)).own(pushed)


def pushed_in(problem: Problem, baseline: FloatArray, effects: Sequence[Any]) -> tuple[Slow, ...]:
    """Return the model's response to disturbances of unit power, as slow processes."""
    interval_s = problem.interval_s
    return tuple(
        Slow(remembers=math.exp(-rate * interval_s), drive=-power * math.expm1(-2.0 * rate * interval_s) / (2.0 * rate))
        for rate, power in problem.forgetting(baseline, effects)
    )


def disturbance_of_fit(problem: Problem, fitted: Fit) -> Disturbance:
    """Return the likeliest disturbance of a fit's residual, on the steps that were fitted."""
    return _residuals_of(problem, fitted).own(_pushed(problem, fitted))


def whitened_for_disturbance(problem: Problem, fitted: Fit) -> Fit:
    """Return the same model with its residual whitened for the disturbance that it implies."""
    whitener = fitted.whitener.with_slow(disturbance_of_fit(problem, fitted).slow)
    return fit(problem, whitener, fitted, fitted.fitted, rounds=0)


def deviance_near(problem: Problem, nearest: Fit) -> float:
    """Return minus twice the log likelihood of a model with its disturbance, for the likeliest numbers near a fit.

    Their misfit of the measured quantity may exceed that of the fit as far as the disturbance misleads a fit in all but
    one of twenty draws: if weighting the rows moves the numbers farther, something is missing, and fast changes would
    be followed at the expense of everything else. It is the full likelihood of the actual residual: the restricted one
    excludes the part that the numbers absorb, which differs from model to model.
    """
    found = _likeliest(problem, nearest)
    most = nearest.squares + float(np.quantile(_followed(problem, nearest, found), _ALL_BUT))
    moved = nearest
    for _ in range(_ALTERNATED):
        moved = fit(problem, nearest.whitener.with_slow(found.slow), moved, moved.fitted, rounds=_REFITTED)
        inside = _towards(problem, nearest, moved, most)
        again = _likeliest(problem, inside)
        if again.deviance > found.deviance - _SETTLED or inside.point is not moved.point:
            return min(again.deviance, found.deviance)
        found = again
    return found.deviance


def most_followed(problem: Problem, fitted: Fit) -> float:
    """Return the largest reduction of the sum of squares by a fit's numbers, over many drawn disturbances.

    The disturbances have the memory of the air: that of a fit's residual appears to be shorter.
    """
    found = _residuals_of(problem, fitted).remembered(_pushed(problem, fitted))
    return float(_followed(problem, fitted, found).max())


def _followed(problem: Problem, fitted: Fit, found: Disturbance) -> FloatArray:
    """Return how much a fit's numbers reduce the sum of squares of each drawn disturbance, shape (draws,)."""
    drawn = _drawn(problem, fitted, found)
    return np.asarray(np.einsum("ij,jk,ik->i", drawn, fitted.inverse_information, drawn))


def _towards(problem: Problem, nearest: Fit, moved: Fit, most: float) -> Fit:
    """Return the model between the nearest and a moved one, as far as its sum of squares is at most `most`."""
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
    """Return the products of drawn disturbances with the derivatives of a fit, shape (draws, p)."""
    draws = np.random.default_rng(0)
    noise = draws.standard_normal((_DRAWS, fitted.residual.size))
    for process in found.slow:
        pushes = math.sqrt(process.drive) * draws.standard_normal(noise.shape)
        for run in gap_free(problem.time_s, problem.interval_s):  # each run begins without a disturbance
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
    """Residuals for which disturbances are tried, with the derivatives of the fit.

    A fit absorbs the slowest part of a disturbance, so that its residual appears to have a shorter memory than the air.
    The disturbance is therefore that of the part that the derivatives cannot absorb (Patterson & Thompson, Biometrika
    58, 1971).
    """

    def __init__(self, problem: Problem, columns: FloatArray, counted: BoolArray) -> None:
        """Take derivatives and, in the last row, the residual, shape (p + 1, n)."""
        weight = problem.usable.astype(np.float64)
        self._bare = Whitener(interval_s=problem.interval_s, weight=weight, time_s=problem.time_s)
        self._columns, self._rows = columns, problem.usable & counted
        self._count = float(np.count_nonzero(self._rows))
        squares = float(np.mean(columns[-1][self._rows] ** 2))
        self._floor = max(problem.rounding**2, 1e-12 * squares, 1e-24)
        self._lasts = float(problem.time_s[-1] - problem.time_s[0]) / problem.interval_s

    def with_slow(self, slow: tuple[Slow, ...]) -> Disturbance:
        """Return one disturbance with its likelihood and its likeliest white noise."""
        whitener = self._bare.with_slow(slow)
        white = whitener(self._columns)[:, self._rows]
        # the last number is the residual's remainder, the others give the determinant of the derivatives' products
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
        """Return the disturbance with the least `key`: none, or `pushed` processes of at most their own memory."""
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
        return min(self.with_slow(()), at(np.asarray(found)), key=key)

    def own(self, pushed: tuple[Slow, ...]) -> Disturbance:
        """Return the `pushed` processes by the restricted likelihood, unless another one is far likelier."""
        likeliest, own = self.likeliest(pushed, _restricted), self.remembered(pushed)
        return own if own.restricted < likeliest.restricted + _REFUTED else likeliest

    def remembered(self, pushed: tuple[Slow, ...]) -> Disturbance:
        """Return the `pushed` processes with the size of the largest restricted likelihood."""
        most = self._longest(pushed)
        found = scipy.optimize.minimize_scalar(
            lambda size: self._of(pushed, most, math.exp(size)).restricted,
            bounds=(math.log(_SIZES[0]), math.log(_SIZES[-1])),
            method="bounded",
            options={"xatol": 0.05},
        )
        return self._of(pushed, most, math.exp(found.x))

    def _longest(self, pushed: tuple[Slow, ...]) -> float:
        """Return the memory of the slowest process in rows, at most the length of the recording."""
        slowest = max((one.remembers for one in pushed), default=0.0)
        longest = -1.0 / math.log(slowest) if 0.0 < slowest < 1.0 else math.inf * slowest
        return max(min(longest, self._lasts), 2.0 * _SHORTEST)

    def _of(self, pushed: tuple[Slow, ...], memory: float, size: float) -> Disturbance:
        """Return the disturbance of the processes with memories limited to `memory` rows."""
        variances = [one.drive / max(1.0 - one.remembers**2, 1.0 / self._lasts) for one in pushed]
        drives: dict[float, float] = {}
        for one, variance in zip(pushed, variances, strict=True):
            if variance > _NEGLIGIBLE * sum(variances):
                remembers = min(max(one.remembers, math.exp(-1.0 / _SHORTEST)), math.exp(-1.0 / memory))
                drives[remembers] = drives.get(remembers, 0.0) + size * one.drive
        total = sum(one.drive for one in pushed)
        slow = tuple(Slow(remembers=key, drive=drive / total) for key, drive in drives.items())
        return self.with_slow(slow)


def with_disturbance(problem: Problem, fitted: Fit) -> Fit:
    """Return the fit with the covariance of its numbers under its disturbance; unchanged if there is none.

    Disturbances of that memory and size are drawn, and the changes of the numbers by each of them computed.
    """
    if not problem.disturbed:
        return fitted
    moved = _drawn(problem, fitted, disturbance_of_fit(problem, fitted)) @ fitted.inverse_information
    return replace(fitted, disturbed_covariance=np.atleast_2d(moved.T @ moved / _DRAWS))
