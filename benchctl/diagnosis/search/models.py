"""Models with an effect more or less: screened, fitted and judged alike."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fitting.fit import Fit, Point, fit, gain_kept, gain_of
from benchctl.diagnosis.fitting.noise import Whitener
from benchctl.diagnosis.fitting.noise_model import NoiseModel
from benchctl.diagnosis.fitting.occam import occam
from benchctl.diagnosis.keys import Place, may_join, place_of
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.search.held_out import dealt, held_out_steps
from benchctl.diagnosis.search.probes import probes_of
from benchctl.diagnosis.search.scans import SCANNED, proposals
from benchctl.diagnosis.search.scatter import scatter
from benchctl.diagnosis.search.screen import Scored, Screening, screen
from benchctl.diagnosis.signals.blocks import block_starts
from instruments.physics.effects.effect import DescribedEffect

IntArray = npt.NDArray[np.int64]

_TRIED = 6
_WORTH_TRYING = 0.2
"""Share of the best promise below which an effect is not fitted: where it starts is near enough for that."""
_IMPERFECT = 0.02
"""Share of what an effect does by which its model may miss it: so much of its gain, squared, is left to others."""
_ROUNDED = 0.01
"""Share of the rounding's variance that may follow the motion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """A model with one effect more: its fit, and what it promises after what chance adds to the gain.

    `evidence` is the gain less what the effect's freedom has cost: by it effects are compared.
    """

    fit: Fit
    promise: float
    evidence: float

    @property
    def added(self) -> DescribedEffect:
        """The effect that it has more."""
        return self.fit.point.effects[-1]


class Models:
    """A problem's models on the steps that choose, beside what was found of the noise so far.

    `rounding_v2` [unit²] is the variance of what a coarse converter rounds off.
    """

    def __init__(self, problem: Problem, seed: int, progress: Callable[[str, float], None], rounding_v2: float) -> None:
        self._problem, self._seed, self._progress = problem, seed, progress
        self._rounding_v2 = rounding_v2
        self._folds = dealt(problem)
        self._held = held_out_steps(problem)
        self._fitted = ~self._held
        self._probes = [probe for kind in problem.effects.values() for probe in probes_of(problem, kind)]
        self._noise = NoiseModel.of(problem)
        self._threshold: float | None = None
        self._bare: tuple[Whitener, Fit] | None = None
        self._rivals: dict[Place, tuple[str, ...]] = {}

    def _screened(self, present: Fit, shares: tuple[float, float], kinds: frozenset[str] | None = None) -> Screening:
        """The probes' promise beside a model; meanwhile the share that is done goes from one to the other."""
        proposed = (
            () if kinds is not None and not kinds & SCANNED else proposals(self._problem, self._noise.whitener, present)
        )
        probes = [probe for probe in (*self._probes, *proposed) if kinds is None or probe.identifier in kinds]
        done = itertools.count()

        def told(name: str) -> None:
            self._progress(name, shares[0] + (shares[1] - shares[0]) * next(done) / len(probes))

        return screen(
            self._problem,
            self._noise.whitener,
            present,
            probes,
            seed=self._seed,
            threshold=self._threshold,
            progress=told,
        )

    def _fit(self, start: Point | Fit) -> Fit:
        return fit(self._problem, self._noise.whitener, start, self._fitted)

    def _without(self, present: Fit, *effects: DescribedEffect) -> Fit:
        gone = [place_of(effect) for effect in effects]
        rest = tuple(one for one in present.point.effects if place_of(one) not in gone)
        return self._fit(Point(baseline=present.point.baseline, effects=rest))

    def _least(self, beside: Fit) -> float:
        """What something more must gain beside a model: more than chance brings, and what imperfect models leave."""
        if self._bare is None or self._bare[0] is not self._noise.whitener:
            self._bare = self._noise.whitener, self._fit(Point(baseline=beside.point.baseline)).light
        explained = max(gain_of(beside, self._bare[1]), 0.0) if beside.point.effects else 0.0
        rounded = _ROUNDED * beside.rows * self._rounding_v2 / beside.deviation**2
        return (self._threshold or 0.0) + _IMPERFECT**2 * explained + rounded

    def _with(self, present: Fit, scored: Scored) -> Tried:
        start: DescribedEffect = scored.probe.start(scored.weights)
        fitted = self._fit(replace(present.point, effects=(*present.point.effects, start)))
        gain, look_elsewhere = gain_of(fitted, present), 2.0 * math.log(scored.probe.places)
        return Tried(
            fit=fitted,
            promise=gain / self._scatter(fitted, present) - look_elsewhere,
            evidence=gain - occam(fitted, len(fitted.point.effects) - 1) - look_elsewhere,
        )

    def _scatter(self, better: Fit, worse: Fit) -> float:
        return self._scatter_over(block_starts(better.white.size), better, worse)

    def _scatter_over(self, starts: IntArray, better: Fit, worse: Fit) -> float:
        rows = self._fitted[self._problem.step]
        return scatter((worse.white - better.white) * rows, worse.white * rows, starts)

    def _promising(self, present: Fit, screening: Screening) -> list[Scored]:
        """What is worth a fit: the best place, still free, of each effect that chance does not bring."""
        known = present.point.effects
        free = tuple(one for one in screening.scored if may_join(one.probe.columns[0], known))
        ranked = replace(screening, scored=free).best_of_each()
        least = max(self._least(present), _WORTH_TRYING * ranked[0].promise) if ranked else 0.0
        return [one for one in ranked if one.promise > least][:_TRIED]

    def _best(self, present: Fit, screening: Screening) -> Tried | None:
        """The best model with one effect more that holds on steps which it was not fitted to."""
        best: Tried | None = None
        names: list[str] = []
        for scored in self._promising(present, screening):
            tried = self._with(present, scored)
            names.append(tried.added.identifier)
            if best is not None and tried.evidence <= best.evidence:
                continue
            if tried.promise > self._least(present) and gain_kept(tried.fit, present, self._folds) > 0.0:
                best = tried
        if best is not None:
            self._rivals[place_of(best.added)] = tuple(names)
        return best
