"""Unnamed heat in a chamber, or times at which its air loses more: both act through the lag of the air.

The air responds to heat with a lag. The gain of a function of a coordinate is therefore a sum over all pairs of its
bins; the response to each bin is simulated once. Structures are compared like named effects: each model includes the
disturbance that it needs and pays for its parameters and for all places that were tried (see `search.subsets`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from benchctl.diagnosis.chamber.problem import ChamberProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.residual.residual_structure import ResidualStructure, residual_structure_with_disturbance
from benchctl.diagnosis.search.models import may_be_nothing
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.search.subsets import CHANCE, evidence_for, price_of, select_subset, stuck
from benchctl.diagnosis.structures.along import Along, Begun, everywhere
from benchctl.diagnosis.structures.search import NEARLY, Modelled, few_of_each
from benchctl.estimation.disturbance import deviance_near, whitened_for_disturbance, with_disturbance
from benchctl.estimation.fit import Fit, Point, fit, inverse
from benchctl.side_by_side import shared_out
from benchctl.signals.binning import bin_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structure_places import StructureStage
from benchctl_instruments.physics.structures import Structure, freed, unmoved

_BINS = 200
_MOST, _ROUNDS = 2, 4
"""Maximum number of structures, and maximum number of search rounds."""
_BETTER = 1.0
"""Minimum gain in twice the log likelihood, after the price is subtracted."""
_REFINED, _FEW = 8, 2
"""Number of shapes per set of effects and coordinate whose places are refined, and number that are fitted.

The expected gain of a shape can be far too low if a named effect of the set has followed the missing structure.
"""
_SIZED, _FITTED = 4, 30
_HALF, _TENTH = 0.5, 0.1
"""Maximum residual with a structure, relative to that of the named effects alone, in amplitude; with other names."""
_OF_TIME = ("ambient_drift", "loss_step")
"""Effects that can follow, as functions of time, what a function of a measured coordinate explains."""
_TIE = 10.0
"""Models whose scores differ by less explain the recording equally well."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Begun:
    """A structure to be added to a fit, and the price of all its structures."""

    base: Fit
    structure: Structure
    paid: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Candidate:
    """A model whose last structure is new: the price of its structures, and its score including this price."""

    fit: Fit
    paid: float
    score: float

    @property
    def takes(self) -> tuple[int, bool]:
        """The number of parameters, and whether the last structure is a function of time."""
        return sum(len(one.parameters) for one in self.fit.point.effects), self.structures[-1].over == "time"

    @property
    def structures(self) -> tuple[Structure, ...]:
        """The structures of the model."""
        return _structures(self.fit)


def heat_modelled(problem: ChamberProblem, chosen: Selection, *, left: bool, seed: int) -> Modelled | None:
    """Return the selection with structures of heat or loss and the effects found with them; None if none pays off.

    An effect found first may take the place of a structure, and a structure that of effects. A structure is therefore
    searched together with each subset of the effects, either replacing or extending the structures found so far; then
    all effects are searched again with these structures. `left` is True if the named effects leave a residual.
    """
    of_names = _score(problem, chosen.after)
    judged = _Judged(problem=problem, named=chosen, of_names=of_names, left=left, seed=seed)
    score, paid = of_names, 0.0
    structures: tuple[Structure, ...] = ()
    ties: tuple[str, ...] = ()
    scanned: set[str] | None = None
    single: list[_Candidate] = []
    for _ in range(_ROUNDS):
        names = {one.identifier for one in _names(chosen.after)}
        if names != scanned:
            scanned, single = names, _candidates(problem, chosen, (), 0.0)
        candidates = single
        if 0 < len(structures) < _MOST:
            candidates = single + _candidates(problem, chosen, structures, paid)
        least = _TIE if structures else _BETTER  # a tie is not an improvement
        found = judged.best(chosen, candidates, score, least)
        if found is None:
            break
        chosen, score, paid, ties = found.model, found.score, found.paid, found.ties
        structures = _structures(chosen.after)
    if not structures:
        return None
    after = chosen.after
    bare = fit(problem, after.whitener, Point(baseline=after.point.baseline, effects=_names(after)), after.fitted)
    return Modelled(
        chosen=replace(chosen, named=bare), structures=structures, ties=ties, left=disturbed_residual(problem, after)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    """A model with its score, the price of its structures, and whether it may replace the named effects."""

    model: Selection
    score: float
    paid: float
    ties: tuple[str, ...]
    may_be: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class _Judged:
    """The judgement of models with structures against the `named` effects, whose score is `of_names`."""

    problem: ChamberProblem
    named: Selection
    of_names: float
    left: bool
    seed: int

    def best(self, chosen: Selection, candidates: list[_Candidate], score: float, least: float) -> _Found | None:
        """Return the model that improves a `score` by at least `least` and may be true; None if there is none.

        Heat or openings of the chamber are tried first, whichever score better. An opening is visible only while it
        lasts: on held-out steps the first one may explain nothing without a second one.
        """
        openings = _openings(candidates)
        others = [one for one in candidates if not _are_openings(one.structures)]
        for some in sorted((others, openings), key=_least):
            found = self._better(chosen, some, score, least)
            if some is openings and found is not None and not found.may_be:
                found = self._opened_again(found)
            if found is not None and found.may_be:
                return found
        return None

    def _opened_again(self, found: _Found) -> _Found | None:
        """Return the model with a second opening; None if there is none or the first model has two."""
        known = _structures(found.model.after)
        if len(known) == _MOST:
            return None
        again = _candidates(self.problem, found.model, known, found.paid)
        return self._better(found.model, _openings(again), found.score, _TIE)

    def _better(self, chosen: Selection, candidates: list[_Candidate], score: float, least: float) -> _Found | None:
        """Return the model of the simplest of the best candidates, if it improves a `score` by at least `least`."""
        candidates = [one for one in candidates if one.score < score - least]
        best = _simplest(candidates, score)
        found = None if best is None else self._with(best, chosen, candidates, score)
        return found if found is not None and found.score <= score - least else None

    def _with(self, best: _Candidate, chosen: Selection, candidates: list[_Candidate], score: float) -> _Found:
        """Return the model of a candidate with the names found with it or, if it may not be, with its own names."""
        problem, ties = self.problem, _tied(best, candidates)
        model = _with_names(problem, best.structures, self.seed)
        if _are_openings(best.structures) and not _known(model, best):  # their places suited other names
            model = _with_names(problem, _structures(model.after), self.seed)
        its = _score(problem, model.after) + best.paid
        needless = len(model.after.numbers) > len(best.fit.numbers) and its >= best.score - _tie(best, score)
        may_be = not needless and self._may_be(model, its)
        if not may_be:
            model = _with_these(problem, chosen, best.fit)
            its = _score(problem, model.after) + best.paid
            may_be = self._may_be(model, its)
        return _Found(model=model, score=its, paid=best.paid, ties=ties, may_be=may_be)

    def _may_be(self, model: Selection, its: float) -> bool:
        return _may_be(self.problem, self.named, model, self.of_names - its, left=self.left)


def _structures(fitted: Fit) -> tuple[Structure, ...]:
    return tuple(one for one in fitted.point.effects if isinstance(one, Structure))


def _names(fitted: Fit) -> tuple[DescribedEffect, ...]:
    return tuple(one for one in fitted.point.effects if not isinstance(one, Structure))


def _may_be(problem: ChamberProblem, named: Selection, model: Selection, gain: float, *, left: bool) -> bool:
    """Return whether a model with structures may replace the named effects; `gain` is its advantage in the score.

    A real disturbance never matches its model exactly, and functions of time or of the air temperature can follow it,
    together with named effects. A model with structures is therefore accepted only if it has fewer effects than before;
    or if the named effects leave a residual, and the model keeps them all, or one structure replaces one effect and
    leaves none; or if one structure, with or in place of one effect, halves the residual amplitude on held-out steps;
    or if one structure is better than the one effect that it replaces, and more specific. Openings always have to halve
    this amplitude, or reduce it to a tenth if they are found with other names.
    """
    before, after = ({one.identifier: one for one in _names(it.after)} for it in (named, model))
    found = _structures(model.after)
    gone = [one for name, one in before.items() if name not in after]
    without_new = after.keys() <= before.keys() and len(gone) <= 1
    missed = _missed(problem, model) / _missed(problem, named)
    halved = missed < _HALF**2
    if _are_openings(found):
        return missed < _TENTH**2 or (without_new and halved)
    if len(after) + len(found) < len(before) or (left and before.keys() <= after.keys()):
        return True
    if len(found) > 1 or not without_new:
        return False
    if halved:
        return True
    if gone and _is_more_specific(found[0], gone[0]):
        return gain > _TIE
    return left and not disturbed_residual(problem, model.after).significant


def _known(model: Selection, best: _Candidate) -> bool:
    """Return whether all names of a model are those of a candidate."""
    return {one.identifier for one in _names(model.after)} <= {one.identifier for one in _names(best.fit)}


def _least(candidates: list[_Candidate]) -> float:
    return min((one.score for one in candidates), default=math.inf)


def _openings(candidates: list[_Candidate]) -> list[_Candidate]:
    """Return the models whose structures are all openings."""
    return [one for one in candidates if _are_openings(one.structures)]


def _are_openings(structures: tuple[Structure, ...]) -> bool:
    """Return whether all structures are times during which the air loses more heat, or less."""
    return all(one.is_opening for one in structures)


def _is_more_specific(structure: Structure, effect: DescribedEffect) -> bool:
    """Return whether a function of a measured coordinate replaces one of the same coordinate, or of time."""
    return structure.over != "time" and (structure.over == effect.coordinate or effect.identifier in _OF_TIME)


def _missed(problem: ChamberProblem, chosen: Selection) -> float:
    """Return the sum of squared residuals [K²] on the held-out steps, or on all steps if none are held out."""
    steps = chosen.heldout if chosen.heldout.any() else ~chosen.heldout
    missed = chosen.after.residual[steps[problem.step] & problem.usable]
    return float(missed @ missed)


def _with_these(problem: ChamberProblem, chosen: Selection, fitted: Fit) -> Selection:
    """Return the selection with the structures and the named effects of a fit."""
    full = fitted
    if chosen.heldout.any():
        full = fit(problem, fitted.whitener, fitted, np.ones_like(fitted.fitted), rounds=_FITTED)
    effects = fitted.point.effects
    evidence = {
        key: evidence_for(problem, fitted, effect, chosen.heldout)
        for key, effect in zip(keys_of(effects), effects, strict=True)
    }
    return replace(chosen, after=fitted, full=with_disturbance(problem, full), evidence=evidence)


def _with_names(problem: ChamberProblem, structures: tuple[Structure, ...], seed: int) -> Selection:
    """Return a selection of these structures and of the named effects found with them.

    The places of the structures are fixed during the search: with too few effects in the model, the structures would
    follow what the missing effects explain.
    """
    held = tuple(unmoved(one, ("shape",)) for one in structures)
    chosen = select_subset(problem, seed=seed, progress=lambda _name, _share: None, fixed=held)

    full = with_disturbance(problem, _all_free(problem, chosen.full))
    return replace(chosen, after=_all_free(problem, chosen.after), full=full)


def _all_free(problem: ChamberProblem, one: Fit) -> Fit:
    """Return the fit with the places of its structures free."""
    free = tuple(freed(effect) if isinstance(effect, Structure) else effect for effect in one.point.effects)
    return fit(problem, one.whitener, replace(one.point, effects=free), one.fitted, rounds=_FITTED)


def disturbed_residual(problem: ChamberProblem, fitted: Fit) -> ResidualStructure:
    """Return the residual structure of a fit, with the disturbance that the fit needs in the noise model."""
    white = whitened_for_disturbance(problem, fitted)
    return residual_structure_with_disturbance(problem, white.whitener, white)


def _score(problem: ChamberProblem, fitted: Fit) -> float:
    """Return minus twice the log likelihood of a model with its disturbance, plus the price of its named effects."""
    return deviance_near(problem, fitted) + sum(price_of(problem, one) for one in _names(fitted))


def _simplest(candidates: list[_Candidate], score: float) -> _Candidate | None:
    """Return the simplest of the candidates that explain nearly as much as the best one; None if there are none."""
    best = min(candidates, key=lambda one: one.score, default=None)
    if best is None:
        return None
    alike = [one for one in candidates if one.score < best.score + _tie(best, score)]
    return min(alike, key=lambda one: (*one.takes, one.score))


def _tie(best: _Candidate, score: float) -> float:
    """Return the difference of scores that a simpler model may have, if the best one improves a `score`."""
    return max(_TIE, (1.0 - NEARLY) * (score - best.score))


def _tied(best: _Candidate, candidates: list[_Candidate]) -> tuple[str, ...]:
    """Return the other coordinates over which the last structure would explain as much."""
    words = dict.fromkeys(one.structures[-1].word for one in candidates if one.score < best.score + _TIE)
    return tuple(word for word in words if word != best.structures[-1].word)


def _candidates(
    problem: ChamberProblem, chosen: Selection, known: tuple[Structure, ...], paid: float
) -> list[_Candidate]:
    """Return models with one structure added to the `known` ones and to each subset of the named effects."""
    names = _names(chosen.after)
    sets = itertools.chain.from_iterable(itertools.combinations(names, size) for size in range(len(names) + 1))

    def scanned(some: tuple[DescribedEffect, ...]) -> list[_Begun]:
        start = Point(baseline=chosen.after.point.baseline, effects=(*some, *known))
        base = fit(problem, chosen.after.whitener, start, chosen.after.fitted, rounds=_FITTED)
        begun = [list(everywhere([along])) for along in _along(problem, base)]
        places = sum(one.places for one in itertools.chain.from_iterable(begun))

        def price(one: Begun) -> float:
            return float(chdtri(len(one.effect.parameters), CHANCE / max(places, 1.0)))

        def worth(one: Begun) -> float:
            return one.promise - price(one)

        def best(found: list[Begun]) -> Iterator[Begun]:
            refined = sorted(found, key=worth, reverse=True)[:_REFINED]
            ranked = sorted((one.refined() for one in refined), key=worth, reverse=True)
            return itertools.islice(few_of_each(ranked), _FEW)

        return [
            _Begun(base=base, structure=one.effect, paid=paid + price(one))
            for one in itertools.chain.from_iterable(map(best, begun))
        ]

    begun = itertools.chain.from_iterable(shared_out(scanned, sets))
    fitted = shared_out(lambda one: _fitted(problem, one), begun)
    return [one for one in fitted if one is not None]


def _fitted(problem: ChamberProblem, begun: _Begun) -> _Candidate | None:
    """Fit the model with a structure, its sizes first, without effects that are then not significant or at a bound.

    Return None if this applies to a structure. A single opening keeps its place if it would follow a second one.
    """
    base, added = begun.base, begun.structure
    there = replace(base.point, effects=(*base.point.effects, unmoved(added, ("shape",))))
    sized = fit(problem, base.whitener, there, base.fitted, rounds=_SIZED)
    one = _all_free(problem, sized)
    structures = _structures(one)
    if (
        _are_openings(structures)
        and len(structures) == 1
        and (stuck(structures[0]) or _score(problem, sized) < _score(problem, one))
    ):
        one = sized
    while needless := _needless(problem, one):
        effects = one.point.effects
        if any(isinstance(effects[place], Structure) for place in needless):
            return None
        kept = tuple(effect for place, effect in enumerate(effects) if place not in needless)
        one = fit(problem, base.whitener, replace(one.point, effects=kept), base.fitted, rounds=_FITTED)
    return _Candidate(fit=one, paid=begun.paid, score=_score(problem, one) + begun.paid)


def _needless(problem: ChamberProblem, fitted: Fit) -> set[int]:
    """Return the indices of the effects at a bound or, if there are none, of those that are not significant."""
    at_bounds = {place for place, one in enumerate(fitted.point.effects) if stuck(one)}
    return at_bounds or may_be_nothing(problem, with_disturbance(problem, fitted))


def _along(problem: ChamberProblem, base: Fit) -> Iterator[Along]:
    """Yield the residual's gradient sums per coordinate, without what the fit's own parameters can follow."""
    white = whitened_for_disturbance(problem, base)
    rows = base.fitted[problem.step] & (white.whitener.weight > 0.0)
    derivatives = white.derivatives * rows[:, None]
    covariance = inverse(derivatives.T @ derivatives)
    left = white.white * rows
    left = left - derivatives @ (covariance @ (derivatives.T @ left))
    deviation = math.sqrt(float(left @ left) / max(float(np.count_nonzero(rows)) - len(base.numbers), 1.0))
    for (stage, over), (values, per_unit_k) in _coordinates(problem, base).items():
        span = float(values.min()), float(values.max())
        if not span[0] < span[1]:
            continue
        edges = np.linspace(*span, _BINS + 1)
        pushes = np.zeros((_BINS, values.size))
        pushes[bin_of(values, edges), np.arange(values.size)] = per_unit_k
        felt = problem.responses(base.point.baseline, base.point.effects, pushes, heated=over == "heater")
        columns = white.whitener(felt) * rows / deviation
        yield Along(
            middle=0.5 * (edges[:-1] + edges[1:]),
            pull=columns @ left / deviation,
            information=columns @ columns.T,
            known=columns @ derivatives,
            covariance=covariance,
            span=span,
            place=(stage, over, ""),
        )


def _coordinates(
    problem: ChamberProblem, base: Fit
) -> Mapping[tuple[StructureStage, str], tuple[FloatArray, FloatArray | float]]:
    """Return stages and coordinates, each with its values and the heat per unit of a structure [K]; shapes (n,).

    The air temperature is that of the model. A larger loss takes heat in proportion to the air's excess over the room.
    """
    rows, numbers = problem.rows, base.point.baseline
    air_c = problem.air_c(numbers, base.point.effects)
    places: dict[tuple[StructureStage, str], tuple[FloatArray, FloatArray | float]] = {
        ("heat", "time"): (rows.clock_s, 1.0),
        ("heat", "chamber_temp"): (air_c, 1.0),
    }
    if rows.kind == "power":
        places["heat", "heater"] = rows.drive, 1.0
        places["loss", "time"] = rows.clock_s, problem.room_c(numbers) - air_c
    return places
