"""Every small set of effects, fitted and compared: what a chamber's data demand beside what disturbs its air.

A disturbance is felt for long, so a model that grows effect by effect follows its first mistake: half of what is
missing looks like a drift, and the next effect mends that. Sets of up to three are few enough to fit them all. Each is
fitted to the measured quantity itself. One that misses it by more than a disturbance would do is out; the others are
judged by the likelihood of what they leave beside the disturbance that each needs. Every effect must gain more than
chance brings to its numbers (Wilks, Annals of Mathematical Statistics 9, 1938) from among all effects and places.
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
from benchctl.diagnosis.search.probes import probes_of
from benchctl.diagnosis.search.screen import screen
from benchctl.diagnosis.search.select import may_be_nothing
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.estimation.disturbance import deviance_near, most_followed, with_disturbance
from benchctl.estimation.fit import Fit, Point, fit, gain_of, judged
from benchctl.estimation.noise_model import NoiseModel
from benchctl.estimation.point import at_bound
from benchctl.estimation.problem import Problem
from benchctl.side_by_side import shared_out
from benchctl_instruments.arrays import BoolArray
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structures import Structure

_MOST, _MOST_BESIDE = 3, 2
"""Sets of up to so many effects are fitted, and of so many beside structures."""
_LOOKED, _PLACES = 2, 3
"""Beside fewer effects than so many a look says where another one begins, at so many places."""
_FIRST_ROUNDS, _ROUNDS, _FOLLOWED = 4, 30, 2
CHANCE = 0.001
"""How often chance may bring what an effect must gain: one in a thousand, as a disturbance is never quite as taken."""
_SEARCHED = 0.9
"""Share of a diagnosis that is this search."""

_Names = tuple[str, ...]
"""Identifiers of the effects of a set, in the order of their names."""


def select_subset(
    problem: Problem, *, seed: int, progress: Callable[[str, float], None], beside: tuple[Structure, ...] = ()
) -> Selection:
    """Find what a `disturbed` problem's data demand: the likeliest of all small sets of which everything is needed.

    Structures may be there `beside` every set.
    """
    return _Subsets(problem, progress, beside).selection(seed)


def price_of(problem: Problem, effect: DescribedEffect | None = None) -> float:
    """What an effect must gain, in twice the log likelihood; of none at all what the least of one number must."""
    parameters = () if effect is None else effect.parameters.values()
    free = sum(one.role not in ("choice", "assumed") for one in parameters)
    places = math.prod(len(one.scan) for one in parameters if one.role == "shape")
    return float(chdtri(max(free, 1), CHANCE / (places * max(len(problem.effects), 1))))


def evidence_beside(problem: Problem, fitted: Fit, effect: DescribedEffect, heldout: BoolArray) -> Evidence:
    """What speaks for an effect of a fit: against the same without it."""
    others = tuple(one for one in fitted.point.effects if one is not effect)
    less = fit(problem, fitted.whitener, replace(fitted.point, effects=others), fitted.fitted)
    return Evidence(
        gain=gain_of(fitted, less),
        heldout=gain_of(fitted, less, heldout),
        scatter=1.0,
        excess=(judged(problem, less) ** 2 - judged(problem, fitted) ** 2).astype(np.float32),
    )


class _Subsets:
    """The sets of effects that were tried, by their names."""

    def __init__(self, problem: Problem, progress: Callable[[str, float], None], beside: tuple[Structure, ...]) -> None:
        self._problem = problem
        self._held = held_out_steps(problem)
        self._untouched = Point(baseline=problem.baseline_start)
        noise = NoiseModel.of(problem)
        self._noise = noise.levelled(problem, fit(problem, noise.whitener, self._untouched, ~self._held))
        self._tried: dict[_Names, Fit] = {(): self._fit(replace(self._untouched, effects=beside))}
        self._scores: dict[_Names, float] = {}
        self._probes = [probe for kind in problem.effects.values() for probe in probes_of(problem, kind)]
        kinds = sorted(problem.effects)
        most = _MOST_BESIDE if beside else _MOST
        for size in range(1, most + 1):
            sets = list(itertools.combinations(kinds, size))
            self._try(sets, progress, (_SEARCHED * (size - 1) / most, _SEARCHED * size / most))
        for size in range(most - 1, 0, -1):
            self._begin_from_larger(itertools.combinations(kinds, size))

    def selection(self, seed: int) -> Selection:
        """The best set of which everything may be stated, and what speaks for each part of it."""
        problem, names = self._problem, self._to_state()
        after, everything = self._tried[names], np.ones_like(self._held)
        whole = fit(problem, self._noise.whitener, after, everything) if self._held.any() else after
        screening = screen(
            problem, self._noise.whitener, after, self._probes, seed=seed, threshold=price_of(self._problem)
        )
        return Selection(
            before=fit(problem, self._noise.plain, self._untouched, ~self._held),
            after=after,
            whole=with_disturbance(problem, whole),
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
        """Fit each set again from the nearest larger one, less what that has more: it may have ended far away.

        Where what comes of it is no nearer than chance brings (two lags that change places), it stays as it is.
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
        """A set fitted from all that have one effect less; None where something of it stands at a bound every time.

        The starts from which the first rounds come nearest are followed to their end, till some have come to one.
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
        """Where a set begins with one effect more; beside several effects as it was beside all but one of them."""
        if len(less) < _LOOKED:
            yield from (point for point in self._begun[less] if point.effects[-1].identifier == added)
            return
        point = self._tried[less].point
        for fewer in _each_without_one(less):
            beside = self._tried.get(tuple(sorted((*fewer, added))))
            for more in () if beside is None else beside.point.effects:
                if more.identifier == added:
                    yield replace(point, effects=(*point.effects, more))

    def _look(self, less: _Names) -> Iterator[Point]:
        """Where each effect more begins: of a fair size, and at the places that promise most for what is left."""
        present = self._tried[less]
        point = present.point
        for baseline, more in self._problem.starts(point.baseline, point.effects):
            yield Point(baseline=baseline, effects=(*point.effects, more))
        seen = screen(self._problem, self._noise.whitener, present, self._probes, seed=0, threshold=0.0)
        taken: Counter[str] = Counter()
        for one in sorted(seen.scored, key=lambda one: -one.gain):
            taken[one.probe.identifier] += 1
            if taken[one.probe.identifier] <= _PLACES:
                yield replace(point, effects=(*point.effects, one.probe.start(one.weights)))

    def _fit(self, start: Point | Fit, rounds: int = _ROUNDS) -> Fit:
        return fit(self._problem, self._noise.whitener, start, ~self._held, rounds=rounds)

    def _score(self, names: _Names) -> float:
        """Minus twice the log likelihood of a set beside its disturbance, and what its effects pay."""
        if names not in self._scores:
            fitted = self._tried[names]
            pays = sum(price_of(self._problem, one) for one in fitted.point.effects)
            self._scores[names] = deviance_near(self._problem, fitted) + pays
        return self._scores[names]

    @cached_property
    def _nearest(self) -> _Names:
        """The set that comes nearest of those of which everything is sure."""
        return next(filter(self._is_sure, sorted(self._tried, key=lambda names: self._tried[names].squares)))

    @cached_property
    def _near(self) -> list[_Names]:
        """The sets that miss no more than a nearest one and what a disturbance may make of it, the likeliest first.

        A disturbance large enough to hide all that is missing would make anything as likely. How large it is, the
        nearest of all and the nearest that is sure say; either may have followed most of it.
        """
        nearest = min(self._tried.values(), key=lambda fitted: fitted.squares), self._tried[self._nearest]
        most = max(fitted.squares + most_followed(self._problem, fitted) for fitted in nearest)
        near = [names for names, fitted in self._tried.items() if fitted.squares <= most]
        deque(shared_out(self._score, near), maxlen=0)
        return sorted(near, key=self._score)

    def _to_state(self) -> _Names:
        """Of the near sets of which every effect earns its price and is sure the likeliest; the nearest if none is."""
        for names in self._near:
            less = [some for some in self._near if set(some) < set(names)]
            if all(self._score(names) < self._score(some) for some in less) and self._is_sure(names):
                return names
        return self._nearest

    def _is_sure(self, names: _Names) -> bool:
        """Whether every effect of a set is more than nothing."""
        return not may_be_nothing(self._problem, with_disturbance(self._problem, self._tried[names]))

    def _evidence(self, names: _Names, fitted: Fit) -> Iterator[Evidence]:
        for effect in fitted.point.effects:
            if isinstance(effect, Structure):
                yield evidence_beside(self._problem, fitted, effect, self._held)
            else:
                yield self._of_name(names, effect)

    def _of_name(self, names: _Names, effect: DescribedEffect) -> Evidence:
        """Against the best without the effect, and against sets that have another in its place."""
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
        """Of a set's subsets the one that comes nearest."""
        subsets = [names for names in self._tried if set(names) <= set(rest)]
        return min(subsets, key=lambda names: self._tried[names].squares)


def _inside(fitted: Fit) -> bool:
    """Whether no effect of a fit stands at a bound; only such sets are kept."""
    return not any(map(stuck, fitted.point.effects))


def stuck(effect: DescribedEffect) -> bool:
    """Whether an effect stands at a bound; a step that is as narrow as one can be told does not count."""
    return at_bound(effect) and not (isinstance(effect, Structure) and effect.is_sharp)


def _each_without_one(names: _Names) -> Iterator[_Names]:
    return itertools.combinations(names, len(names) - 1)
