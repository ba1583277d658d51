"""Selection: what the data demand, added one by one, refitted together, and dropped where it is not needed any more."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fitting.fit import Fit, Point, fit, gain_kept, gain_of
from benchctl.diagnosis.fitting.noise import Whitener
from benchctl.diagnosis.fitting.noise_model import NoiseModel
from benchctl.diagnosis.fitting.noisy import Noisy
from benchctl.diagnosis.fitting.occam import occam
from benchctl.diagnosis.fitting.wandering import PROCESSES
from benchctl.diagnosis.keys import Place, keys_of, may_join, place_of
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.search.probes import probes_of
from benchctl.diagnosis.search.scans import SCANNED, proposals
from benchctl.diagnosis.search.screen import Scored, Screening, scatter, screen
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.diagnosis.signals.blocks import block_starts, step_starts
from instruments.physics.effects.effect import DescribedEffect

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

_MOST_FINDINGS = 5
_TRIED = 6
_RIVALS = 3
_MOST_SWAPS = 6
_SEARCHED, _EACH_ROUND = 0.9, 0.5
"""Share of a diagnosis that is the search, and of what is left of it that each further effect is taken to need."""
_WORTH_TRYING = 0.2
"""Share of the best promise below which an effect is not fitted: where it starts is near enough for that."""
_IMPERFECT = 0.02
"""Share of what an effect does by which its model may miss it: so much of its gain, squared, is left to others."""
_ROUNDED = 0.01
"""Share of the rounding's variance that may follow the motion."""
_HELD_OUT = 6
"""One step in so many of a kind chooses nothing and fits nothing."""


def _share_done(rounds: int) -> float:
    """How much of a diagnosis is done after so many screenings; how many there will be nobody knows."""
    return _SEARCHED * (1.0 - _EACH_ROUND**rounds)


def held_out_steps(problem: Problem) -> BoolArray:
    """Whole steps, one in six of each kind, that play no part in choosing or fitting; mask of shape (m,)."""
    return np.asarray(_dealt(problem) == _HELD_OUT // 2)


def _dealt(problem: Problem) -> IntArray:
    """Steps of each kind dealt out in turn, shape (m,)."""
    places: dict[str, int] = {}
    dealt = []
    for kind in problem.step_kinds:
        dealt.append(places.get(kind, 0) % _HELD_OUT)
        places[kind] = places.get(kind, 0) + 1
    return np.array(dealt, dtype=np.int64)


def select(
    problem: Problem, *, seed: int, progress: Callable[[str, float], None], rounding_v2: float = 0.0
) -> Selection:
    """Find what a problem's data demand.

    `rounding_v2` [unit²] is the variance of what a coarse converter rounds off: where motion sweeps its steps slowly or
    alike each time, that is no noise, and what explains a small share of it only is not believed.
    """
    return _Search(problem, seed, progress, rounding_v2).run()


def without(problem: Problem, chosen: Selection, key: str) -> Fit:
    """The fit of all but the effect of a key, on the steps that chose."""
    return fit(problem, chosen.whitener, _dropped(chosen.after.point, {key}), chosen.after.fitted)


def reduced(problem: Problem, chosen: Selection, keys: Collection[str]) -> Selection:
    """The selection without some of what was chosen, effects and noises, the rest refitted and its keys made anew."""
    noise = chosen.noise.dropped(keys)

    def fitted(one: Fit) -> Fit:
        return fit(problem, noise.whitener, _dropped(one.point, keys), one.fitted)

    after = fitted(chosen.after)
    kept = [one for key, one in chosen.evidence.items() if key not in keys]
    return replace(
        chosen,
        after=after,
        whole=fitted(chosen.whole),
        noise=noise,
        evidence=dict(zip(keys_of(after.point.effects), kept, strict=True)),
    )


def _dropped(point: Point, keys: Collection[str]) -> Point:
    named = zip(keys_of(point.effects), point.effects, strict=True)
    return replace(point, effects=tuple(effect for key, effect in named if key not in keys))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Tried:
    """A model with one effect more: its fit, and what it promises after what chance adds to the gain.

    `evidence` is the gain less what the effect's freedom has cost: by it effects are compared.
    """

    fit: Fit
    promise: float
    evidence: float

    @property
    def added(self) -> DescribedEffect:
        return self.fit.point.effects[-1]


class _Search:
    def __init__(self, problem: Problem, seed: int, progress: Callable[[str, float], None], rounding_v2: float) -> None:
        self._problem, self._seed, self._progress = problem, seed, progress
        self._rounding_v2 = rounding_v2
        self._folds = _dealt(problem)
        self._held = held_out_steps(problem)
        self._fitted = ~self._held
        self._probes = [probe for kind in problem.effects.values() for probe in probes_of(problem, kind)]
        self._noise = NoiseModel.of(problem)
        self._threshold: float | None = None
        self._bare: tuple[Whitener, Fit] | None = None
        self._rivals: dict[Place, tuple[str, ...]] = {}

    def run(self) -> Selection:
        untouched = Point(baseline=self._problem.baseline_start)
        present = self._fit(untouched)
        self._noise = self._noise.levelled(self._problem, present)
        present = self._fit(present.point)
        for number in range(_MOST_FINDINGS + 1):
            screening = self._screened(present, (_share_done(number), _share_done(number + 1)))
            self._threshold = screening.threshold
            if number == _MOST_FINDINGS:
                break
            least = self._least(present)
            noisy = self._noise.best(self._problem, present, least_gain=least)
            tried = self._best(present, screening)
            if noisy is not None and (tried is None or self._noise_first(present, noisy, tried, least)):
                self._noise = self._noise.with_(noisy)
                present = self._fit(present.point)
                continue
            if tried is None:
                tried = self._instead_of_process(present, _share_done(number + 1))
            if tried is None:
                break
            present = self._remeasured(self._pruned(tried.fit), least)
        present = self._remeasured(present, self._least(present))
        present, evidence = self._settled(present)
        plain = self._noise.plain
        everything = np.ones_like(self._fitted)
        return Selection(
            before=fit(self._problem, plain, untouched, self._fitted),
            after=present,
            whole=fit(self._problem, self._noise.whitener, present.point, everything) if self._held.any() else present,
            noise=self._noise,
            screening=screening,
            evidence=evidence,
            heldout=self._held,
        )

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

    def _fit(self, point: Point) -> Fit:
        return fit(self._problem, self._noise.whitener, point, self._fitted)

    def _least(self, beside: Fit) -> float:
        """What something more must gain beside a model: more than chance brings, and what imperfect models leave."""
        if self._bare is None or self._bare[0] is not self._noise.whitener:
            self._bare = self._noise.whitener, self._fit(Point(baseline=beside.point.baseline))
        explained = max(gain_of(beside, self._bare[1]), 0.0) if beside.point.effects else 0.0
        rounded = _ROUNDED * beside.rows * self._rounding_v2 / beside.deviation**2
        return (self._threshold or 0.0) + _IMPERFECT**2 * explained + rounded

    def _remeasured(self, present: Fit, threshold: float) -> Fit:
        """The fit with what was found of the noise measured beside it."""
        if not self._noise.found:
            return present
        self._noise = self._noise.measured(self._problem, present, least_gain=threshold)
        return self._fit(present.point)

    def _with(self, present: Fit, scored: Scored) -> _Tried:
        start: DescribedEffect = scored.probe.start(scored.weights)
        fitted = self._fit(replace(present.point, effects=(*present.point.effects, start)))
        gain, look_elsewhere = gain_of(fitted, present), 2.0 * math.log(scored.probe.places)
        return _Tried(
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

    def _best(self, present: Fit, screening: Screening) -> _Tried | None:
        """The best model with one effect more that holds on steps which it was not fitted to."""
        best: _Tried | None = None
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

    def _without(self, present: Fit, *effects: DescribedEffect) -> Fit:
        gone = [place_of(effect) for effect in effects]
        rest = tuple(one for one in present.point.effects if place_of(one) not in gone)
        return self._fit(Point(baseline=present.point.baseline, effects=rest))

    def _noise_first(self, present: Fit, noisy: Noisy, tried: _Tried, least: float) -> bool:
        """Whether noise is to be taken before an effect.

        A process follows anything slow: it may gain more than the effect that it stands for. But beside that effect a
        process of its own has always the same size, and one that stands for it a much smaller one.
        """
        if noisy.gain <= tried.evidence:
            return False
        beside = self._noise.best(self._problem, tried.fit, least_gain=least)
        effect_first = tried.evidence + (beside.gain if beside is not None else 0.0)
        whitener = noisy.whitener
        both, alone = (fit(self._problem, whitener, one.point, self._fitted) for one in (tried.fit, present))
        return effect_first <= noisy.gain + max(gain_of(both, alone), 0.0) + least

    def _instead_of_process(self, present: Fit, share: float) -> _Tried | None:
        """An effect that a process stands for, without the process; None, and all stays, where there is none.

        What else is missing hides it at first: as long as the residual is full of something, either follows it badly.
        """
        found = self._noise
        process = next((found.found[name] for name in PROCESSES if name in found.found), None)
        if process is None:
            return None
        self._noise = found.dropped({process.effect})
        bare = self._fit(present.point)
        tried = self._best(bare, self._screened(bare, (share, share)))
        noisy = replace(process, whitener=found.whitener)
        if tried is not None and not self._noise_first(bare, noisy, tried, self._least(bare)):
            return tried
        self._noise = found
        return None

    def _pruned(self, present: Fit) -> Fit:
        """Without the effects that are no longer needed."""
        for effect in present.point.effects[:-1]:
            less = self._without(present, effect)
            if gain_of(present, less) / self._scatter(present, less) < self._least(less):
                present = less
        return present

    def _settled(self, present: Fit) -> tuple[Fit, dict[str, Evidence]]:
        """Every effect against none and against its rivals, with all others in place, until none gives way."""
        for _ in range(_MOST_SWAPS):
            evidence: dict[str, Evidence] = {}
            for key, effect in zip(keys_of(present.point.effects), present.point.effects, strict=True):
                less = self._without(present, effect)
                own = self._evidence(present, less)
                if own.gain / own.scatter < self._least(less):
                    present = less
                    break
                rivals, nearest, better = self._rivalled(present, less, effect)
                if better is not None:
                    present = better.fit
                    self._rivals[place_of(better.added)] = (*rivals, effect.identifier)
                    break
                evidence[key] = replace(own, rivals=rivals, nearest=nearest)
            else:
                one = self._one_for_two(present)
                if one is None:
                    return present, evidence
                present = one
        return present, {
            key: self._evidence(present, self._without(present, one))
            for key, one in zip(keys_of(present.point.effects), present.point.effects, strict=True)
        }

    def _one_for_two(self, present: Fit) -> Fit | None:
        """The model with one effect in place of two that it is like, where the two do no better; None if none is.

        Beside either of the two there is nothing left for it to explain: it shows only without both.
        """
        for two in itertools.combinations(present.point.effects, 2):
            kinds = frozenset(two[0].look_alikes) & frozenset(two[1].look_alikes) & self._problem.effects.keys()
            if not kinds:
                continue
            less = self._without(present, *two)
            for scored in self._promising(less, self._screened(less, (_SEARCHED, _SEARCHED), kinds)):
                tried = self._with(less, scored)
                if gain_of(present, tried.fit) / self._scatter(present, tried.fit) < self._least(tried.fit):
                    self._rivals[place_of(tried.added)] = tuple(effect.identifier for effect in two)
                    return tried.fit
        return None

    def _evidence(self, present: Fit, less: Fit) -> Evidence:
        """Once nothing else is missing, an effect has to bear witness in all steps alike.

        The rounding of an encoder's angles repeats itself in a swing that lasts a whole number of samples: within such
        a step it does not average out, but no other step repeats it (Liang & Zeger, Biometrika 73, 1986).
        """
        by_steps = self._scatter_over(step_starts(self._problem.step), present, less)
        return Evidence(
            gain=gain_of(present, less),
            heldout=gain_of(present, less, self._held),
            scatter=max(self._scatter(present, less), by_steps),
            excess=(less.white**2 - present.white**2).astype(np.float32),
        )

    def _rivalled(
        self, present: Fit, less: Fit, effect: DescribedEffect
    ) -> tuple[dict[str, float], Point | None, _Tried | None]:
        """By how much rivals in the effect's place are worse, the model with the nearest, and the best if better."""
        mine = gain_of(present, less) - occam(present, present.point.effects.index(effect))
        kinds = frozenset({*self._rivals.get(place_of(effect), ()), *effect.look_alikes, effect.identifier})
        rivals: dict[str, float] = {}
        best: _Tried | None = None
        nearest: _Tried | None = None
        promising = self._promising(less, self._screened(less, (_SEARCHED, _SEARCHED), kinds))
        others = [one for one in promising if place_of(one.probe.columns[0]) != place_of(effect)]
        for scored in others[:_RIVALS]:
            tried = self._with(less, scored)
            if best is None or tried.evidence > best.evidence:
                best = tried
            if tried.added.identifier == effect.identifier:
                continue
            rivals[tried.added.identifier] = mine - tried.evidence
            if nearest is None or tried.evidence > nearest.evidence:
                nearest = tried
        return (
            rivals,
            None if nearest is None else nearest.fit.point,
            best if best is not None and best.evidence > mine else None,
        )
