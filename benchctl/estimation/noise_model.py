"""The model of a recording's noise: its white level, the encoder's contribution, and further findings."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy.optimize import minimize_scalar

from benchctl.estimation.fit import Fit
from benchctl.estimation.noise import Noisy, Whitener
from benchctl.estimation.problem import Problem
from benchctl.estimation.wandering import PROCESSES, wandering
from benchctl.signals.normal import QUARTILE
from benchctl_instruments.arrays import BoolArray, FloatArray

GROWING = "noise_rate_dependent"


def between_rows(problem: Problem, residual: FloatArray) -> float:
    """Return the white noise of a residual (n,) from differences of neighbouring rows; 0 if there are none.

    It uses their median: omissions of the model are slow or rare compared with it (pure error, not lack of fit).
    """
    counted = problem.usable[1:] & problem.usable[:-1]
    steps = np.abs(np.diff(residual))[counted]
    return float(np.median(steps)) / QUARTILE / math.sqrt(2.0) if steps.size else 0.0


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """The whitener, the one without any finding (`plain`), and the findings, by effect."""

    plain: Whitener
    whitener: Whitener
    level: float
    found: Mapping[str, Noisy] = field(default_factory=dict)

    @property
    def pure_error(self) -> float:
        """Standard deviation of an innovation if the residual is only white noise."""
        return self.level * self.whitener.innovation

    @classmethod
    def of(cls, problem: Problem) -> Self:
        """Return white noise of one size on all usable rows."""
        plain = Whitener(
            interval_s=problem.interval_s,
            weight=problem.usable.astype(np.float64),
            time_s=problem.time_s,
        )
        return cls(plain=plain, whitener=plain, level=0.0)

    def levelled(self, problem: Problem, fitted: Fit) -> Self:
        """Return the model with the level of the white noise from a fit, and the encoder's contribution on each row.

        The level is estimated from differences of neighbouring rows.
        """
        level = between_rows(problem, fitted.residual) or fitted.deviation
        level = max(level, float(np.finfo(np.float64).eps) * problem.full_scale)  # for a noiseless simulation
        added, _ = problem.regressor_variance
        weight = problem.usable / np.sqrt(1.0 + added / level**2)
        plain = replace(self.plain, weight=weight)
        return replace(self, plain=plain, whitener=plain, level=level)

    def leaving_out(self, rows: BoolArray) -> Self:
        """Return the model with zero weight for some rows, given as a mask of shape (n,)."""

        def less(whitener: Whitener) -> Whitener:
            return replace(whitener, weight=np.where(rows, 0.0, whitener.weight))

        found = {name: replace(one, whitener=less(one.whitener)) for name, one in self.found.items()}
        return replace(self, plain=less(self.plain), whitener=less(self.whitener), found=found)

    def with_(self, noisy: Noisy) -> Self:
        """Return the model with one more finding; a wandering bias of another kind is replaced."""
        rivals = set(PROCESSES) if noisy.effect in PROCESSES else {noisy.effect}
        kept = {name: one for name, one in self.found.items() if name not in rivals}
        return replace(self, whitener=noisy.whitener, found={**kept, noisy.effect: noisy})

    def dropped(self, names: Collection[str]) -> Self:
        """Return the model without some of its findings."""
        kept = [one for name, one in self.found.items() if name not in names]
        if len(kept) == len(self.found):
            return self
        # growth with the rate is in the weights, wander in the filter: each whitener may include both
        grows = next((one for one in kept if one.effect == GROWING), None)
        slow = next((one.whitener.slow for one in kept if one.effect in PROCESSES), ())
        weight = self.plain.weight if grows is None else grows.whitener.weight
        whitener = replace(self.plain, weight=weight, slow=slow)
        return replace(self, whitener=whitener, found={one.effect: one for one in kept})

    def best(self, problem: Problem, fitted: Fit, *, least_gain: float, rival: float = -math.inf) -> Noisy | None:
        """Return the additional finding with the largest gain above `least_gain`; None if there is none.

        Slow processes that certainly gain less than a `rival` are skipped.
        """
        tried: list[Noisy] = []
        if not set(PROCESSES) & self.found.keys():
            tried += [one for one in [self.wandering(problem, fitted, least_gain, rival)] if one is not None]
        if GROWING in problem.noises - self.found.keys():
            tried += [one for one in [self._growing(problem, fitted)] if one.gain > least_gain]
        return max(tried, key=lambda one: one.gain, default=None)

    def measured(self, problem: Problem, fitted: Fit, *, least_gain: float = 0.0) -> Self:
        """Return the same findings, measured again for another fit; those that gain too little are dropped."""
        model = replace(self, whitener=self.plain, found={})
        if GROWING in self.found:
            again = self._growing(problem, fitted)
            again = replace(again, whitener=again.whitener.with_slow(()))
            model = model.with_(again) if again.gain > least_gain else model
        if set(PROCESSES) & self.found.keys():
            best = model.wandering(problem, fitted, least_gain)
            model = model.with_(best) if best is not None else model
        return model

    def wandering(self, problem: Problem, fitted: Fit, least_gain: float, rival: float = -math.inf) -> Noisy | None:
        """Return the slow process with the largest gain; None if too small or certainly less than a rival's."""
        tried = wandering(problem, self.whitener, fitted, least_gain=least_gain, rival=rival)
        best = max(tried, key=lambda one: one.gain, default=None)
        if best is None:
            return None
        return replace(best, rivals={one.effect: best.gain - one.gain for one in tried if one is not best})

    def simplified(self, problem: Problem, fitted: Fit, relative: FloatArray, *, least_gain: float) -> Self:
        """Return the model without growth over the rate if `relative` noise of the rows, shape (n,), explains it."""
        if GROWING not in self.found:
            return self
        even = replace(fitted, white=fitted.white / relative)
        return self if self._growing(problem, even).gain > least_gain else self.dropped({GROWING})

    def _growing(self, problem: Problem, fitted: Fit) -> Noisy:
        weight = self.plain.weight
        counted = (weight > 0.0) & fitted.fitted[problem.step]
        rest = np.divide(fitted.white, self.whitener.weight, out=np.zeros_like(weight), where=counted)
        share = problem.coordinates["rate"] / problem.circumstances["range_dps"]
        added, step = problem.regressor_variance
        found = growing(rest, counted, share, step / self.level**2)
        grown = 1.0 + added / self.level**2 + found.growth * share**2
        return Noisy(
            effect=GROWING,
            gain=found.gain,
            size=found.growth,
            log_error=found.log_error,
            whitener=replace(self.whitener, weight=(weight > 0.0) / np.sqrt(grown)),
        )


_MOST_GROWTH = math.log(100.0**2 - 1.0)
_LEAST_GROWTH = math.log(1e-4)
_LOG_STEP = 0.05
_NORMAL_KURTOSIS = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Growing:
    """Noise of variance σ²·(1 + growth·(ω/range)²): the gain over none, the growth, and its logarithm's error."""

    gain: float
    growth: float
    log_error: float

    @property
    def factor(self) -> float:
        """Noise at full rate over noise at rest."""
        return math.sqrt(1.0 + self.growth)


def growing(innovation: FloatArray, counted: BoolArray, share_of_range: FloatArray, known: FloatArray) -> Growing:
    """Estimate the growth of noise with the rate from innovations [σ] of shape (n,) of rows that count.

    It uses differences of neighbouring samples, which are free of omissions of the model and of slow changes; each
    sample belongs to one difference, so that these are independent.

    `share_of_range` is ω/range; `known` is the additional variance [σ²] of half a difference from the encoder's noise:
    all of shape (n,).
    """
    first = 2 * np.arange(innovation.size // 2)
    first = first[counted[first] & counted[first + 1]]
    half = 0.5 * (innovation[first + 1] - innovation[first]) ** 2
    squared_rate, added = share_of_range[first] ** 2, known[first]
    if first.size < 100 or float(np.ptp(squared_rate)) < 0.01:
        return Growing(gain=0.0, growth=0.0, log_error=math.inf)

    def deviance(growth: float) -> float:
        shape = 1.0 + growth * squared_rate + added
        return first.size * math.log(float(np.mean(half / shape))) + float(np.log(shape).sum())

    found = minimize_scalar(lambda log: deviance(math.exp(log)), bounds=(_LEAST_GROWTH, _MOST_GROWTH), method="bounded")
    log = float(found.x)
    low, here, high = (deviance(math.exp(log + k * _LOG_STEP)) for k in (-1, 0, 1))
    curvature = max((low - 2.0 * here + high) / _LOG_STEP**2, 1e-6)
    shape = half / (1.0 + math.exp(log) * squared_rate + added)
    kurtosis = float(np.mean(shape**2)) / float(np.mean(shape)) ** 2
    # heavy tails make a variance less certain than with normal noise
    odd = max((kurtosis - 1.0) / (_NORMAL_KURTOSIS - 1.0), 1.0)
    return Growing(gain=(deviance(0.0) - here) / odd, growth=math.exp(log), log_error=math.sqrt(2.0 * odd / curvature))
