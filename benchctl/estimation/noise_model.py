"""What is known of a recording's noise: its white level, what the encoder adds, and what of it has been found."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from benchctl.estimation.fit import Fit
from benchctl.estimation.growing import growing
from benchctl.estimation.noise import Noisy, Whitener
from benchctl.estimation.problem import Problem
from benchctl.estimation.wandering import PROCESSES, wandering
from benchctl.signals.normal import QUARTILE
from benchctl_instruments.arrays import FloatArray

GROWING = "noise_rate_dependent"


def between_rows(problem: Problem, residual: FloatArray) -> float:
    """Deviation of the white noise of a residual (n,), by differences of neighbouring rows; 0 where there are none.

    Their median is taken: whatever a model has left out is slow or rare against it (pure error, not lack of fit).
    """
    counted = problem.usable[1:] & problem.usable[:-1]
    steps = np.abs(np.diff(residual))[counted]
    return float(np.median(steps)) / QUARTILE / math.sqrt(2.0) if steps.size else 0.0


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """The whitener, the one without any finding (`plain`), and what was found, by effect."""

    plain: Whitener
    whitener: Whitener
    level: float
    found: Mapping[str, Noisy] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem) -> Self:
        """White noise of one size on all usable rows."""
        plain = Whitener(
            interval_s=problem.interval_s,
            weight=problem.usable.astype(np.float64),
            time_s=problem.time_s,
        )
        return cls(plain=plain, whitener=plain, level=0.0)

    def levelled(self, problem: Problem, fitted: Fit) -> Self:
        """With the level of the white noise from a fit, and what the encoder's noise adds to it on each row.

        The level is seen in differences of neighbouring rows.
        """
        level = between_rows(problem, fitted.residual) or fitted.deviation
        level = max(level, float(np.finfo(np.float64).eps) * problem.full_scale)  # of a noiseless simulation
        whole, _ = problem.regressor_variance
        weight = problem.usable / np.sqrt(1.0 + whole / level**2)
        plain = replace(self.plain, weight=weight)
        return replace(self, plain=plain, whitener=plain, level=level)

    def with_(self, noisy: Noisy) -> Self:
        """With one thing more found; a wandering bias of another kind gives way."""
        rivals = set(PROCESSES) if noisy.effect in PROCESSES else {noisy.effect}
        kept = {name: one for name, one in self.found.items() if name not in rivals}
        return replace(self, whitener=noisy.whitener, found={**kept, noisy.effect: noisy})

    def dropped(self, names: Collection[str]) -> Self:
        """Without some of what was found."""
        kept = [one for name, one in self.found.items() if name not in names]
        if len(kept) == len(self.found):
            return self
        # what grows with the rate is in the weights, what wanders in the filter: each whitener may hold both
        grows = next((one for one in kept if one.effect == GROWING), None)
        slow = next((one.whitener.slow for one in kept if one.effect in PROCESSES), ())
        weight = self.plain.weight if grows is None else grows.whitener.weight
        whitener = replace(self.plain, weight=weight, slow=slow)
        return replace(self, whitener=whitener, found={one.effect: one for one in kept})

    def best(self, problem: Problem, fitted: Fit, *, least_gain: float, rival: float = -math.inf) -> Noisy | None:
        """What would gain most of what has not been found yet, where it gains enough.

        Slow processes that are sure to gain less than a `rival` are left alone.
        """
        tried: list[Noisy] = []
        if not set(PROCESSES) & self.found.keys():
            tried += [one for one in [self.wandering(problem, fitted, least_gain, rival)] if one is not None]
        if GROWING in problem.noises - self.found.keys():
            tried += [one for one in [self._growing(problem, fitted)] if one.gain > least_gain]
        return max(tried, key=lambda one: one.gain, default=None)

    def measured(self, problem: Problem, fitted: Fit, *, least_gain: float = 0.0) -> Self:
        """The same findings, each measured anew beside another fit; those that gain too little are gone."""
        model = replace(self, whitener=self.plain, found={})
        if GROWING in self.found:
            again = self._growing(problem, fitted)
            again = replace(again, whitener=again.whitener.beside(()))
            model = model.with_(again) if again.gain > least_gain else model
        if set(PROCESSES) & self.found.keys():
            best = model.wandering(problem, fitted, least_gain)
            model = model.with_(best) if best is not None else model
        return model

    def wandering(self, problem: Problem, fitted: Fit, least_gain: float, rival: float = -math.inf) -> Noisy | None:
        """The slow process that gains most, where one gains enough and not surely less than a rival."""
        tried = wandering(problem, self.whitener, fitted, least_gain=least_gain, rival=rival)
        best = max(tried, key=lambda one: one.gain, default=None)
        if best is None:
            return None
        return replace(best, rivals={one.effect: best.gain - one.gain for one in tried if one is not best})

    def _growing(self, problem: Problem, fitted: Fit) -> Noisy:
        weight = self.plain.weight
        counted = (weight > 0.0) & fitted.fitted[problem.step]
        rest = np.divide(fitted.white, self.whitener.weight, out=np.zeros_like(weight), where=counted)
        share = problem.coordinates["rate"] / problem.circumstances["range_dps"]
        whole, step = problem.regressor_variance
        found = growing(rest, counted, share, step / self.level**2)
        grown = 1.0 + whole / self.level**2 + found.growth * share**2
        return Noisy(
            effect=GROWING,
            gain=found.gain,
            size=found.growth,
            log_error=found.log_error,
            whitener=replace(self.whitener, weight=(weight > 0.0) / np.sqrt(grown)),
        )
