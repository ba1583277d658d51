"""Models with one effect added or removed: screening, fitting and evaluation."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchctl.diagnosis.keys import Place, may_join, place_of
from benchctl.diagnosis.search.held_out import dealt, held_out_steps
from benchctl.diagnosis.search.probes import probes_of
from benchctl.diagnosis.search.scans import SCANNED, proposals
from benchctl.diagnosis.search.scatter import scatter
from benchctl.diagnosis.search.screen import Scored, Screening, screen
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.evidence import occam_factor
from benchctl.estimation.fit import Fit, Point, fit, gain_alone, gain_kept, gain_of
from benchctl.estimation.noise import Whitener
from benchctl.estimation.noise_model import NoiseModel
from benchctl.estimation.point import assumed, at_bound, interval_of, stands_at
from benchctl.signals.blocks import block_starts
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import IntArray
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter
from benchctl_instruments.physics.structures import Structure

_TRIED = 6
_WORTH_TRYING = 0.2
"""Share of the best promise, or of the best gain, below which an effect is not fitted.

The starting place is close enough for that. But a column computed for a small effect leaves a structured residual if
the effect is large, so that its gain scatters; a fit removes this.
"""
ALIKE = 0.01
"""Difference in twice the log likelihood below which two models count as equal, so that rounding does not decide."""
IMPERFECT = 0.02
"""Relative error allowed in the model of an effect: so much of its gain, squared, may go to other effects."""
_ROUNDED = 0.01
"""Share of the rounding's variance that may be correlated with the motion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """A model with one more effect: its fit, and its `promise`, the gain less the expected contribution of chance.

    `evidence` is the gain less the cost of the effect's free parameters; effects are compared by it. Both are −∞ if the
    effect is at a bound of the plausible range, or if one of several recordings contradicts it.
    """

    fit: Fit
    promise: float
    evidence: float

    @property
    def added(self) -> DescribedEffect:
        """The added effect."""
        return self.fit.point.effects[-1]


class Models:
    """A problem's models on the steps used for selection, with the noise found so far.

    `rounding_v2` [unit²] is the variance of a coarse converter's rounding.
    """

    def __init__(
        self, problem: PartProblem, seed: int, progress: Callable[[str, float], None], rounding_v2: float
    ) -> None:
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
        self._refused: set[Place] = set()

    def _screened(self, present: Fit, shares: tuple[float, float], kinds: frozenset[str] | None = None) -> Screening:
        """Return a screening of a model; meanwhile the reported progress goes from the first to the second share."""
        proposed = (
            () if kinds is not None and not kinds & SCANNED else proposals(self._problem, self._noise.whitener, present)
        )
        probes = [probe for probe in (*self._probes, *proposed) if kinds is None or probe.identifier in kinds]
        done = itertools.count()

        def report(name: str) -> None:
            self._progress(name, shares[0] + (shares[1] - shares[0]) * next(done) / len(probes))

        return screen(
            self._problem,
            self._noise.whitener,
            present,
            probes,
            seed=self._seed,
            threshold=self._threshold,
            progress=report,
        )

    def _fit(self, start: Point | Fit) -> Fit:
        fitted = fit(self._problem, self._noise.whitener, start, self._fitted)
        point = assumed(fitted.point)
        return fitted if point is fitted.point else fit(self._problem, self._noise.whitener, point, self._fitted)

    def _without(self, present: Fit, *effects: DescribedEffect) -> Fit:
        gone = [place_of(effect) for effect in effects]
        rest = tuple(one for one in present.point.effects if place_of(one) not in gone)
        return self._fit(Point(baseline=present.point.baseline, effects=rest))

    def _least(self, present: Fit) -> float:
        """Return the gain that a further effect needs to exceed chance and the errors of the present effects."""
        if self._bare is None or self._bare[0] is not self._noise.whitener:
            self._bare = self._noise.whitener, self._fit(Point(baseline=present.point.baseline)).light
        explained = max(gain_of(present, self._bare[1]), 0.0) if present.point.effects else 0.0
        rounded = _ROUNDED * present.rows * self._rounding_v2 / present.deviation**2
        return (self._threshold or 0.0) + IMPERFECT**2 * explained + rounded

    def _with(self, present: Fit, scored: Scored) -> Tried:
        more: DescribedEffect = scored.probe.start(scored.weights)
        start = replace(present.point, effects=(*present.point.effects, more))
        return self._begun_with(present, start, 2.0 * math.log(scored.probe.places))

    def _begun_with(self, present: Fit, start: Point, look_elsewhere: float) -> Tried:
        fitted = self._fit(start)
        added = fitted.point.effects[-1]
        if at_bound(added) or self._driven_to_bound(fitted, present) or not self._agreed(fitted, present):
            return Tried(fit=fitted, promise=-math.inf, evidence=-math.inf)
        return Tried(
            fit=fitted,
            promise=self._beyond_chance(fitted, present) - look_elsewhere,
            evidence=gain_of(fitted, present) - occam_factor(fitted, len(fitted.point.effects) - 1) - look_elsewhere,
        )

    def _driven_to_bound(self, fitted: Fit, present: Fit) -> bool:
        """Return whether a baseline parameter is at a bound of the plausible range and was not before."""
        values = zip(fitted.numbers, fitted.point.baseline.tolist(), present.point.baseline.tolist(), strict=False)
        return any(
            stands_at(there, number.low, number.high) and not stands_at(before, number.low, number.high)
            for number, there, before in values
        )

    def _agreed(self, better: Fit, worse: Fit) -> bool:
        """Return whether no single recording of the same instrument contradicts the gain of all recordings together."""
        recorded = self._problem.recorded
        return not recorded.any() or all(
            gain_alone(better, worse, recorded == one) > -self._least(worse) for one in np.unique(recorded)
        )

    def _beyond_chance(self, better: Fit, worse: Fit) -> float:
        """Return the gain, reduced if chance scatters more than white noise would."""
        return gain_of(better, worse) / self._scatter(better, worse)

    def _scatter(self, better: Fit, worse: Fit) -> float:
        return self._scatter_over(block_starts(better.white.size), better, worse)

    def _scatter_over(self, starts: IntArray, better: Fit, worse: Fit) -> float:
        rows = self._fitted[np.concatenate([self._problem.step, self._problem.spectral_step])]
        good, bad = (np.concatenate([one.white, one.spectral.residual]) * rows for one in (better, worse))
        return scatter(bad - good, bad, np.concatenate([starts, np.arange(better.white.size, rows.size)]))

    def _promising(self, present: Fit, screening: Screening) -> list[Scored]:
        """Return the probes worth a fit: the best free place of each effect that is above chance."""
        least = self._least(present)
        ranked = [one for one in self._free(present, screening).best_of_each() if one.promise > least]
        most_promise = max((one.promise for one in ranked), default=1.0)
        most_gain = max((one.gain for one in ranked), default=1.0)

        def worth(one: Scored) -> float:
            return float(f"{max(one.promise / most_promise, one.gain / most_gain):.6g}")

        tried = sorted((one for one in ranked if worth(one) > _WORTH_TRYING), key=worth, reverse=True)[:_TRIED]
        names = {one.probe.identifier for one in tried}
        hidden = [one for one in self._free(present, screening).scored if one.probe.identifier not in names]
        pulled = max(hidden, key=lambda one: one.probe.pulled, default=None)
        most = max(most_gain, max((one.gain for one in screening.scored), default=0.0))
        if pulled is not None and pulled.probe.pulled > max(_WORTH_TRYING * most, least):
            tried.append(pulled)
        return tried

    def _free(self, present: Fit, screening: Screening) -> Screening:
        """Return the screening without places that are already in the model or were refused."""
        known = present.point.effects
        places = [(one, one.probe.columns[0]) for one in screening.scored]
        free = (one for one, start in places if may_join(start, known) and place_of(start) not in self._refused)
        return replace(screening, scored=tuple(free))

    def _best(self, present: Fit, screening: Screening) -> Tried | None:
        """Return the best model with one more effect that also improves steps it was not fitted to; None if none."""
        best: Tried | None = None
        names: dict[str, None] = {}
        for tried in self._tried(present, screening):
            if tried.promise > 0.0:
                names[tried.added.identifier] = None
            if tried.evidence == -math.inf or (best is not None and tried.evidence <= best.evidence + ALIKE):
                continue
            if tried.promise > self._least(present) and gain_kept(tried.fit, present, self._folds) > 0.0:
                best = tried
        if best is not None:
            self._rivals[place_of(best.added)] = tuple(names)
        return best

    def _tried(self, present: Fit, screening: Screening, kinds: Collection[str] | None = None) -> Iterator[Tried]:
        """Yield the model with each effect worth a fit, and with each start that the problem itself proposes."""
        for scored in self._promising(present, screening):
            yield self._with(present, scored)
        for start in self._starts(present.point):
            if kinds is None or start.effects[-1].identifier in kinds:
                yield self._begun_with(present, start, 0.0)

    def _starts(self, known: Point) -> Iterator[Point]:
        """Yield the problem's own starts with one more effect, without refused ones."""
        for baseline, effect in self._problem.starts(known.baseline, known.effects):
            if place_of(effect) not in self._refused:
                yield Point(baseline=baseline, effects=(*known.effects, effect))


def may_be_nothing(problem: PartProblem, fitted: Fit) -> set[int]:
    """Return the indices of effects whose vanishing parameters all have zero within their 95 % interval.

    Shape parameters, such as a dead time next to a disturbance, which a lag can leave by chance, are tested with the
    wider interval of Schwarz's criterion. The errors are estimated from the scatter between steps; an opening of a
    chamber lies within one or two of them and is not tested.
    """
    errors = fitted.standard_errors(problem.step)
    sizes = [
        [
            _may_be_zero(
                one.parameter,
                effect.values[one.name],
                error * (Z95 if one.parameter.role == "size" else math.sqrt(math.log(fitted.rows))),
            )
            for one, error in zip(fitted.numbers, errors.tolist(), strict=True)
            if one.effect == place and one.parameter is not None and _vanishes(one.parameter)
        ]
        for place, effect in enumerate(fitted.point.effects)
    ]
    nothing = {place for place, small in enumerate(sizes) if small and all(small)}
    return {place for place in nothing if not _is_opening(fitted.point.effects[place])}


def _is_opening(effect: DescribedEffect) -> bool:
    return isinstance(effect, Structure) and effect.is_opening


def _may_be_zero(parameter: Parameter, value: float, half: float) -> bool:
    low, high = interval_of(parameter, value, half)
    return low <= 0.0 <= high


def _vanishes(parameter: Parameter) -> bool:
    """Return whether a parameter is zero when its effect is absent."""
    return parameter.role == "size" or (parameter.zero == 0.0 and not parameter.logarithmic)
