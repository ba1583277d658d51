"""Search over all small sets of effects, for a chamber, whose air has a slow disturbance.

A disturbance acts for a long time, so a model that adds effects one by one can start with the wrong one: half of what
is missing looks like a drift, and the next effect corrects it. There are few enough sets of up to three effects to fit
them all. Each is fitted to the measured quantity itself. A set that misses it by more than a disturbance could is
rejected; the others are compared by the likelihood of their residual, each with the disturbance that it needs. Every
effect must gain more than chance does (Wilks, Annals of Mathematical Statistics 9, 1938), with all effects and places
that were tested taken into account.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.special import chdtri

from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.search.held_out import held_out_steps
from benchctl.diagnosis.search.models import may_be_nothing
from benchctl.diagnosis.search.probes import probes_of
from benchctl.diagnosis.search.screen import screen
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.disturbance import deviance_near, most_followed, with_disturbance
from benchctl.estimation.fit import Fit, Point, fit, gain_of, judged
from benchctl.estimation.noise_model import NoiseModel
from benchctl.estimation.point import at_bound
from benchctl.side_by_side import shared_out
from benchctl_instruments.arrays import BoolArray
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structures import Structure

_MOST, _MOST_WITH_FIXED = 3, 2
"""Maximum number of effects in a set, without and with structures in the model."""
_LOOKED, _PLACES = 2, 3
"""For sets with fewer effects, a screening proposes the starts of one more effect; number of starts per effect."""
_FIRST_ROUNDS, _ROUNDS, _FOLLOWED = 4, 30, 2
CHANCE = 0.001
"""Probability that chance exceeds the required gain; small, because the disturbance model is never exact."""
_SEARCHED = 0.9
"""Share of a diagnosis that this search takes."""

_Names = tuple[str, ...]
"""Identifiers of the effects of a set, in alphabetical order."""


def select_subset(
    problem: PartProblem, *, seed: int, progress: Callable[[str, float], None], fixed: tuple[Structure, ...] = ()
) -> Selection:
    """Find the likeliest of all small sets of effects of a `disturbed` problem in which every effect is needed.

    `fixed` are structures that are part of every model.
    """
    return _Subsets(problem, progress, fixed).selection(seed)


def price_of(problem: PartProblem, effect: DescribedEffect | None = None) -> float:
    """Return the gain in twice the log likelihood that an effect needs; without effect, that of a single parameter."""
    parameters = () if effect is None else effect.parameters.values()
    free = sum(one.role not in ("choice", "assumed") for one in parameters)
    places = math.prod(len(one.scan) for one in parameters if one.role == "shape")
    return float(chdtri(max(free, 1), CHANCE / (places * max(len(problem.effects), 1))))


def evidence_for(problem: PartProblem, fitted: Fit, effect: DescribedEffect, heldout: BoolArray) -> Evidence:
    """Return the evidence for an effect of a fit, compared with the fit without it."""
    others = tuple(one for one in fitted.point.effects if one is not effect)
    less = fit(problem, fitted.whitener, replace(fitted.point, effects=others), fitted.fitted)
    return Evidence(
        gain=gain_of(fitted, less),
        heldout=gain_of(fitted, less, heldout),
        scatter=1.0,
        excess=(judged(problem, less) ** 2 - judged(problem, fitted) ** 2).astype(np.float32),
    )


class _Subsets:
    """The sets of effects that were fitted, by their names."""

    def __init__(
        self, problem: PartProblem, progress: Callable[[str, float], None], fixed: tuple[Structure, ...]
    ) -> None:
        self._problem = problem
        self._held = held_out_steps(problem)
        self._untouched = Point(baseline=problem.baseline_start)
        noise = NoiseModel.of(problem)
        self._noise = noise.levelled(problem, fit(problem, noise.whitener, self._untouched, ~self._held))
        self._tried: dict[_Names, Fit] = {(): self._fit(replace(self._untouched, effects=fixed))}
        self._scores: dict[_Names, float] = {}
        self._probes = [probe for kind in problem.effects.values() for probe in probes_of(problem, kind)]
        kinds = sorted(problem.effects)
        most = _MOST_WITH_FIXED if fixed else _MOST
        for size in range(1, most + 1):
            sets = list(itertools.combinations(kinds, size))
            self._try(sets, progress, (_SEARCHED * (size - 1) / most, _SEARCHED * size / most))
        for size in range(most - 1, 0, -1):
            self._begin_from_larger(itertools.combinations(kinds, size))

    def selection(self, seed: int) -> Selection:
        """Return the best set in which every effect is confirmed, with the evidence for each."""
        problem, names = self._problem, self._to_state()
        after, everything = self._tried[names], np.ones_like(self._held)
        fitted = fit(problem, self._noise.whitener, after, everything) if self._held.any() else after
        screening = screen(
            problem, self._noise.whitener, after, self._probes, seed=seed, threshold=price_of(self._problem)
        )
        return Selection(
            before=fit(problem, self._noise.plain, self._untouched, ~self._held),
            after=after,
            full=with_disturbance(problem, fitted),
            noise=self._noise,
            screening=screening,
            evidence=dict(zip(keys_of(after.point.effects), self._evidence(names, after), strict=True)),
            heldout=self._held,
            least=price_of(self._problem),
        )

    def _try(self, sets: list[_Names], progress: Callable[[str, float], None], shares: tuple[float, float]) -> None:
        smaller = {less for names in sets for less in _each_without_one(names)} & self._tried.keys()
        self._begun = {less: list(self._look(less)) for less in sorted(smaller) if len(less) < _LOOKED}
        for done, (names, tried) in enumerate(zip(sets, shared_out(self._fitted, sets), strict=True)):
            progress(" + ".join(names), shares[0] + (shares[1] - shares[0]) * done / len(sets))
            if tried is not None:
                self._tried[names] = tried

    def _begin_from_larger(self, sets: Iterable[_Names]) -> None:
        """Fit each set again from the nearest larger set without its extra effects, as the first fit may be local.

        The new fit is used only if it gains more than chance does (two lags, for example, may swap roles).
        """
        for names in sets:
            larger = [more for more in self._tried if set(names) < set(more)]
            if larger:
                point = self._tried[min(larger, key=lambda more: self._tried[more].squares)].point
                kept = tuple(one for one in point.effects if one.identifier in names or isinstance(one, Structure))
                again, before = self._fit(replace(point, effects=kept)), self._tried.get(names)
                if _inside(again) and (before is None or gain_of(again, before) > price_of(self._problem)):
                    self._tried[names] = again

    def _fitted(self, names: _Names) -> Fit | None:
        """Return the fit of a set, started from all sets with one effect less; None if it always ends at a bound.

        The starts that are nearest after the first rounds are continued until a few have converged.
        """
        begun: list[Fit] = []
        for less in _each_without_one(names):
            (added,) = set(names) - set(less)
            starts = self._starts(less, added) if less in self._tried else ()
            begun.extend(self._fit(start, _FIRST_ROUNDS) for start in starts)
        inside: list[Fit] = []
        for one in sorted(begun, key=lambda one: one.squares):
            ended = self._fit(one, _ROUNDS)
            if _inside(ended):
                inside.append(ended)
            if len(inside) == _FOLLOWED:
                break
        return min(inside, key=lambda one: one.squares, default=None)

    def _starts(self, less: _Names, added: str) -> Iterator[Point]:
        """Yield starts for a set with one more effect; for larger sets, from its fits in smaller sets."""
        if len(less) < _LOOKED:
            yield from (point for point in self._begun[less] if point.effects[-1].identifier == added)
            return
        point = self._tried[less].point
        for fewer in _each_without_one(less):
            smaller = self._tried.get(tuple(sorted((*fewer, added))))
            for more in () if smaller is None else smaller.point.effects:
                if more.identifier == added:
                    yield replace(point, effects=(*point.effects, more))

    def _look(self, less: _Names) -> Iterator[Point]:
        """Yield starts for each further effect: of moderate size, and at the most promising places of a screening."""
        present = self._tried[less]
        point = present.point
        for baseline, more in self._problem.starts(point.baseline, point.effects):
            yield Point(baseline=baseline, effects=(*point.effects, more))
        screening = screen(self._problem, self._noise.whitener, present, self._probes, seed=0, threshold=0.0)
        taken: Counter[str] = Counter()
        for one in sorted(screening.scored, key=lambda one: -one.gain):
            taken[one.probe.identifier] += 1
            if taken[one.probe.identifier] <= _PLACES:
                yield replace(point, effects=(*point.effects, one.probe.start(one.weights)))

    def _fit(self, start: Point | Fit, rounds: int = _ROUNDS) -> Fit:
        return fit(self._problem, self._noise.whitener, start, ~self._held, rounds=rounds)

    def _score(self, names: _Names) -> float:
        """Return minus twice the log likelihood of a set with its disturbance, plus the price of its effects."""
        if names not in self._scores:
            fitted = self._tried[names]
            pays = sum(price_of(self._problem, one) for one in fitted.point.effects)
            self._scores[names] = deviance_near(self._problem, fitted) + pays
        return self._scores[names]

    @cached_property
    def _nearest(self) -> _Names:
        """The set with the smallest residual among those in which every effect is confirmed; else the empty one.

        In the empty set nothing is confirmed either if its fixed structures cannot be distinguished from zero.
        """
        by_residual = sorted(self._tried, key=lambda names: self._tried[names].squares)
        return next(filter(self._is_sure, by_residual), ())

    @cached_property
    def _near(self) -> list[_Names]:
        """The sets that miss no more than a nearest set and its possible disturbance, the likeliest first.

        A disturbance large enough to hide everything missing would make all sets equally likely. Its size is estimated
        from the nearest set and from the nearest confirmed set; either may have followed most of the disturbance.
        """
        nearest = min(self._tried.values(), key=lambda fitted: fitted.squares), self._tried[self._nearest]
        most = max(fitted.squares + most_followed(self._problem, fitted) for fitted in nearest)
        near = [names for names, fitted in self._tried.items() if fitted.squares <= most]
        deque(shared_out(self._score, near), maxlen=0)
        return sorted(near, key=self._score)

    def _to_state(self) -> _Names:
        """Return the likeliest near set whose effects all earn their price and are confirmed; else `_nearest`."""
        for names in self._near:
            less = [some for some in self._near if set(some) < set(names)]
            if all(self._score(names) < self._score(some) for some in less) and self._is_sure(names):
                return names
        return self._nearest

    def _is_sure(self, names: _Names) -> bool:
        """Return whether every effect of a set is distinguishable from zero."""
        return not may_be_nothing(self._problem, with_disturbance(self._problem, self._tried[names]))

    def _evidence(self, names: _Names, fitted: Fit) -> Iterator[Evidence]:
        for effect in fitted.point.effects:
            if isinstance(effect, Structure):
                yield evidence_for(self._problem, fitted, effect, self._held)
            else:
                yield self._of_name(names, effect)

    def _of_name(self, names: _Names, effect: DescribedEffect) -> Evidence:
        """Return the evidence for an effect: compared with the best set without it and with sets of its rivals."""
        fitted, name, score = self._tried[names], effect.identifier, self._score(names)
        rest = [other for other in names if other != name]
        smaller = [some for some in self._near if set(some) <= set(rest)]
        less = self._tried[smaller[0] if smaller else self._nearest_of(rest)]
        others = {other: tuple(sorted((*rest, other))) for other in self._problem.effects if other not in names}
        others = {other: replaced for other, replaced in others.items() if replaced in self._near}
        rivals = {other: self._score(replaced) - score for other, replaced in others.items()}
        nearest = min(rivals, key=lambda other: rivals[other], default=None)
        before, after = (judged(self._problem, one) for one in (less, fitted))
        return Evidence(
            gain=self._score(smaller[0]) - score + price_of(self._problem, effect)
            if smaller
            else gain_of(fitted, less),
            heldout=gain_of(fitted, less, self._held),
            scatter=1.0,
            excess=(before**2 - after**2).astype(np.float32),
            rivals=rivals,
            nearest=None if nearest is None else self._tried[others[nearest]].point,
            heldout_least=-math.inf,
        )

    def _nearest_of(self, rest: Collection[str]) -> _Names:
        """Return the subset of `rest` with the smallest residual."""
        subsets = [names for names in self._tried if set(names) <= set(rest)]
        return min(subsets, key=lambda names: self._tried[names].squares)


def _inside(fitted: Fit) -> bool:
    """Return whether no effect of a fit is at a bound; only such sets are kept."""
    return not any(map(stuck, fitted.point.effects))


def stuck(effect: DescribedEffect) -> bool:
    """Return whether an effect is at a bound; a step structure with the narrowest detectable width does not count."""
    return at_bound(effect) and not (isinstance(effect, Structure) and effect.is_sharp)


def _each_without_one(names: _Names) -> Iterator[_Names]:
    return itertools.combinations(names, len(names) - 1)
