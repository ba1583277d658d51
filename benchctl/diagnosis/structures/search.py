"""Search for structures: the simplest shape over a coordinate that explains the residual.

The structure of the residual (`rest`) was found without a model and limits what can be explained. Here, shapes over all
coordinates are fitted like effects, jointly with the baseline and the findings. They are compared by evidence, with a
price for each parameter (Schwarz, Annals of Statistics 6, 1978) and for every place tried. Held-out steps decide.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.residual.residual_structure import ResidualStructure, is_attributable, residual_structure_of
from benchctl.diagnosis.search.held_out import least_gain
from benchctl.diagnosis.search.models import IMPERFECT
from benchctl.diagnosis.search.pull import pull_of
from benchctl.diagnosis.search.scatter import scatter
from benchctl.diagnosis.search.select import reduced
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.diagnosis.structures.along import Begun
from benchctl.diagnosis.structures.scan import Structurable, begun_everywhere, encoder_jumps
from benchctl.estimation.fit import Fit, Point, fit, gain_of
from benchctl.estimation.point import at_bound
from benchctl.signals.blocks import block_starts
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structure_shapes import SHAPES
from benchctl_instruments.physics.structures import Structure, unmoved

_NEAR_THE_BEST = 0.4
"""Minimum expected gain of a fitted shape, relative to the best one."""
_REFINED, _FITTED, _OF_ONE_PLACE, _MOST_PLACES = 30, 6, 3, 4
"""Number of shapes that are refined; maximum number fitted, fitted per stage and coordinate, and of these pairs."""
_SIZED = 2
_SHARPER = (0.2, 0.2)
_CANCELLED = 2.0
"""Largest range of what a structure adds, relative to the measured range; other terms cancel a larger one."""
_NOTHING = 1e-3
"""Tolerated loss on held-out steps, where the structure has no influence."""
_KINDS = {
    "gyro_temp": "temperature",
    "gyro_temp_rate": "temperature",
    "chamber_temp": "temperature",
    "setpoint": "temperature",
    "angle": "angle",
    "swing_angle": "angle",
    "time": "time",
}
_MOTION = "motion"
NEARLY = 0.97
"""Minimum gain of a simpler shape over the same coordinate, relative to the best gain."""
_TIE = 10.0
"""Two coordinates whose models differ by less, in twice the log likelihood, are not distinguishable."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Modelled:
    """A selection with structures, other coordinates that explain the first one as well, and the residual."""

    chosen: Selection
    structures: tuple[Structure, ...]
    ties: tuple[str, ...]
    left: ResidualStructure


@dataclass(frozen=True, slots=True, kw_only=True)
class _Candidate:
    fit: Fit
    gain: float
    evidence: float

    @property
    def structure(self) -> Structure:
        added = self.fit.point.effects[-1]
        assert isinstance(added, Structure)  # noqa: S101  # it was fitted as one
        return added


def modelled(
    problem: Structurable,
    chosen: Selection,
    rest: ResidualStructure | None,
    *,
    apart_from: Sequence[DescribedEffect] = (),
    most: int = 3,
    smooth: bool = False,
    worth: float = 0.0,
    bare: Fit | None = None,
    scan: Scan | None = None,
    seed: int,
) -> Modelled | None:
    """Return the selection with the residual modelled by at most `most` structures; None if no shape explains it.

    Shapes over the coordinates of the effects `apart_from` are not tried. Splines are tried only if `smooth` is set,
    one per kind of coordinate, because together they could follow anything. `rest` is None where findings were removed,
    so that the residual is known to have a structure. The first structure must gain at least `worth`. A small residual
    that may be due to an inexact shape is not modelled. `bare` is the fit without structures if the selection already
    contains some. A `scan` of the selection can be shared by several searches.
    """
    scan = Scan(problem, chosen) if scan is None else scan
    taken = {kind_of(word) for effect in apart_from for word in _own(effect.coordinate)}
    found: list[Structure] = []
    ties: tuple[str, ...] = ()
    known = [one for one in chosen.after.point.effects if isinstance(one, Structure)] if bare is not None else []
    bare = chosen.after if bare is None else bare
    for _ in range(2 * most):  # some make others redundant
        if len(found) == most or not (rest is None or rest.significant):
            break
        before = [*known, *found]
        explained = gain_of(chosen.after, bare) if before else 0.0
        minor = before and rest is not None and is_attributable(rest, max(explained, _as_gain(chosen, bare, rest)))
        curved = {kind_of(one.over) for one in before if one.is_smooth} if smooth else {*_KINDS.values(), _MOTION}
        ruled_out = taken | (_followed(before) if minor else set())
        candidates = scan.candidates(ruled_out, curved, IMPERFECT**2 * explained)
        if not candidates or (not found and max(one.gain for one in candidates) < worth):
            break
        best = _sharpened(problem, chosen, _simple_enough(problem, chosen, candidates, seed))
        ties = ties if found else _tied(best, candidates)
        scan = scan.extended_by(best.fit)
        chosen = scan.chosen
        first = found[:1]
        if any(type(one) is type(best.structure) for one in found):  # two of a kind have the same key
            found = [*found, best.structure]
        else:
            chosen, found = _pruned(problem, chosen, found, best.structure)
            scan = scan if chosen is scan.chosen else Scan(problem, chosen)
        ties = ties if not first or found[0] is first[0] else ()
        rest = residual_structure_of(problem, chosen.whitener, chosen.after, seed=seed)
    if not found or rest is None:
        return None
    return Modelled(chosen=chosen, structures=tuple(found), ties=ties, left=rest)


def _simple_enough(problem: Structurable, chosen: Selection, candidates: Sequence[_Candidate], seed: int) -> _Candidate:
    """Return the simplest model over the best coordinate, if its residual is no larger than that of the best model."""
    best = max(candidates, key=lambda one: one.evidence)
    if best.structure.over == "output":  # nearly the same as the rate, which more effects depend on
        rates = [one for one in candidates if one.structure.over == "rate"]
        nearest = max(rates, key=lambda one: one.evidence, default=best)
        best = nearest if nearest.evidence > best.evidence - _TIE else best
    best = _at_one_value(best, candidates)
    simple = _simplest(best, candidates)
    better = max((one for one in candidates if _alike(one, best)), key=lambda one: one.evidence)
    if simple is better:
        return simple
    with_simple = with_last(problem, chosen, simple.fit.point)
    left = residual_structure_of(problem, with_simple.whitener, with_simple.after, seed=seed)
    return better if left.significant else simple


def _tied(best: _Candidate, candidates: Sequence[_Candidate]) -> tuple[str, ...]:
    """Return the other coordinates over which a structure explains as much."""
    most = max(candidates, key=lambda one: one.evidence)
    words = dict.fromkeys(one.structure.word for one in candidates if one.evidence > most.evidence - _tie(most))
    return tuple(word for word in words if word != best.structure.word)


def _as_gain(chosen: Selection, bare: Fit, rest: ResidualStructure) -> float:
    """Return the power explained by structures, scaled like the residual's gain; a log likelihood understates it."""
    counted = chosen.whitener.weight > 0.0
    explained = float(np.mean(bare.residual[counted] ** 2 - chosen.after.residual[counted] ** 2))
    return rest.gain * explained / max(rest.power, 1e-300)


def _pruned(
    problem: Structurable, chosen: Selection, found: list[Structure], last: Structure
) -> tuple[Selection, list[Structure]]:
    """Return the selection and its structures without those that the last one made redundant."""
    kept = found
    for one in found:
        less = reduced(problem, chosen, {one.identifier})
        if gain_of(chosen.after, less.after) < chosen.least + len(one.parameters) * math.log(chosen.after.rows):
            chosen, kept = less, [other for other in kept if other is not one]
    return chosen, [*kept, last]


def _simplest(best: _Candidate, candidates: Sequence[_Candidate]) -> _Candidate:
    """Return the shape with the fewest parameters, at the stage and coordinate of the best, with nearly its gain."""
    alike = [one for one in candidates if _alike(one, best)]
    most = max(one.gain for one in alike)
    return min(
        (one for one in alike if one.gain > NEARLY * most),
        key=lambda one: (len(one.structure.parameters), -one.evidence),
    )


def _at_one_value(best: _Candidate, candidates: Sequence[_Candidate]) -> _Candidate:
    """Return a model over another coordinate with as much evidence and fewer events than one over time, or `best`."""
    if best.structure.over != "time":
        return best
    fewer = [
        one
        for one in candidates
        if one.structure.over != "time"
        and _values(one.structure) < _values(best.structure)
        and one.evidence > best.evidence - _tie(best)
    ]
    return max(fewer, key=lambda one: one.evidence, default=best)


def _tie(best: _Candidate) -> float:
    """Return the evidence by which a model may be below the best one and still tie: the best one may be as inexact."""
    return max(_TIE, IMPERFECT**2 * best.gain)


def _values(structure: Structure) -> int:
    """Return the number of values of the coordinate at which the structure changes."""
    shape = SHAPES[structure.shape]
    return len({*shape.places, *shape.lengths} - {"width"})


def _alike(one: _Candidate, other: _Candidate) -> bool:
    """Return whether both act at the same stage over the same coordinate."""
    mine, its = one.structure, other.structure
    return (mine.acts_on, mine.over, mine.times) == (its.acts_on, its.over, its.times)


def _sharpened(problem: Structurable, chosen: Selection, best: _Candidate) -> _Candidate:
    """Return a step with a smaller width if that is better: a fit cannot resolve edges between its rows."""
    for share in _SHARPER if "width" in best.structure.values and best.structure.is_stepped else ():
        values = best.structure.values
        begun = type(best.structure).make({**values, "width": share * values["width"]})
        one = _candidate(problem, chosen, begun, 0.0)
        if one is None or one.gain <= best.gain:
            break
        best = replace(one, evidence=best.evidence + one.gain - best.gain)
    return best


def with_jumps(problem: GyroProblem, chosen: Selection) -> tuple[Selection, tuple[Structure, ...]]:
    """Return the selection with the significant jumps of the encoder, and these jumps.

    They are searched even if the residual has no significant structure. A jump in a held-out step cannot be predicted
    from other steps, so it is searched and fitted in this step.
    """
    found: list[Structure] = []
    looked = 2.0 * math.log(chosen.after.rows)
    clock = problem.clock_s
    for begun in encoder_jumps(problem, pull_of(problem, chosen.whitener, chosen.full), chosen.noise.pure_error):
        step = int(problem.step[min(int(np.searchsorted(clock, begun.values["at"])), clock.size - 1)])
        if chosen.heldout[step]:
            held = _with_jump_held_out(problem, chosen, begun, looked)
            if held is not None:
                chosen = held
                found.append(begun)
            continue
        one = _candidate(problem, chosen, begun, looked)
        if one is not None:
            chosen = with_last(problem, chosen, one.fit.point)
            found.append(one.structure)
    return chosen, tuple(found)


def _with_jump_held_out(problem: GyroProblem, chosen: Selection, begun: Structure, looked: float) -> Selection | None:
    everything = chosen.full
    point = replace(everything.point, effects=(*everything.point.effects, begun))
    full = fit(problem, chosen.whitener, point, everything.fitted)
    if gain_of(full, everything) - looked < chosen.least or at_bound(full.point.effects[-1]):
        return None
    added = full.point.effects[-1]
    assert isinstance(added, Structure)  # noqa: S101  # it was fitted as one
    point = replace(chosen.after.point, effects=(*chosen.after.point.effects, unmoved(added)))
    return replace(with_last(problem, chosen, point), full=full)


def with_last(problem: Structurable, chosen: Selection, point: Point) -> Selection:
    """Return the selection with the last effect of a point near the best one, fitted with exact derivatives."""
    after = fit(problem, chosen.whitener, point, chosen.after.fitted)
    effects = (*chosen.full.point.effects, after.point.effects[-1])
    everything = np.ones_like(after.fitted)
    full = after
    if chosen.heldout.any():
        full = fit(problem, chosen.whitener, Point(baseline=after.point.baseline, effects=effects), everything)
    gone = chosen.after
    evidence = Evidence(
        gain=gain_of(after, gone),
        heldout=gain_of(after, gone, chosen.heldout),
        scatter=1.0,
        excess=(gone.white**2 - after.white**2).astype(np.float32),
    )
    key = keys_of(after.point.effects)[-1]
    return replace(chosen, after=after, full=full, evidence={**chosen.evidence, key: evidence})


def kind_of(word: str) -> str:
    """Return the kind of a coordinate: motion, temperature, angle or time."""
    return _KINDS.get(word, _MOTION)


def _followed(found: Sequence[Structure]) -> set[str]:
    """Return the kinds of coordinates affected by inexact shapes; temperature and time belong together."""
    kinds = {kind_of(word) for one in found for word in one.word.split("*")}
    return kinds | ({"temperature", "time"} if kinds & {"temperature", "time"} else set())


def _own(coordinate: str) -> list[str]:
    """Return the words of a coordinate; of two, without `rate`, which is due to the scale factor."""
    words = coordinate.split("*")
    return [word for word in words if word != "rate"] or words


class Scan:
    """Models with one more structure than a selection. What was computed for one search serves the next."""

    def __init__(self, problem: Structurable, chosen: Selection) -> None:
        self.chosen = chosen
        self._problem = problem
        self._refined: dict[str, Begun] = {}
        self._fits: dict[str, Fit | None] = {}
        self._extended: dict[tuple[str, ...], Scan] = {}

    def candidates(self, taken: set[str], curved: set[str], missed: float) -> list[_Candidate]:
        """Return models with one additional structure that also hold on held-out steps.

        Coordinates of the kinds in `taken` are excluded, splines also over the kinds in `curved`. A gain up to `missed`
        may be due to inexact earlier structures.
        """
        allowed = [
            one
            for one in self._begun
            if kind_of(one.effect.over) not in taken | (curved if one.effect.is_smooth else set())
        ]
        looked = 2.0 * math.log(max(sum(one.places for one in allowed), 1.0)) + missed
        price = math.log(self.chosen.after.rows)

        def worth(one: Begun) -> float:
            return one.promise - len(one.effect.parameters) * price

        best = sorted(allowed, key=worth, reverse=True)[:_REFINED]
        ranked = sorted((self._refine(one) for one in best), key=worth, reverse=True)
        fits = (self._fit(one.effect) for one in few_of_each(ranked))
        judged = (_judged(self._problem, self.chosen, one, looked) for one in fits if one is not None)
        return [one for one in judged if one is not None]

    def extended_by(self, after: Fit) -> Scan:
        """Return the scan of the selection with the structure that `after` has as its last effect."""
        added = after.point.effects[-1]
        key = added.identifier, *map(repr, added.values.values())
        if key not in self._extended:
            self._extended[key] = Scan(self._problem, with_last(self._problem, self.chosen, after.point))
        return self._extended[key]

    @cached_property
    def _begun(self) -> list[Begun]:
        chosen = self.chosen
        pulls = (pull_of(self._problem, chosen.whitener, one) for one in (chosen.after, chosen.full))
        return begun_everywhere(self._problem, *pulls)

    def _refine(self, begun: Begun) -> Begun:
        key = begun.effect.identifier
        if key not in self._refined:
            self._refined[key] = begun.refined()
        return self._refined[key]

    def _fit(self, begun: Structure) -> Fit | None:
        key = begun.identifier
        if key not in self._fits:
            fitted = _fitted(self._problem, self.chosen, begun)
            self._fits[key] = None if fitted is None else fitted.light
        return self._fits[key]


def few_of_each(ranked: Sequence[Begun]) -> Iterator[Begun]:
    """Yield the best candidates: a few per place, one spline per place, none with a gain far below the best."""
    counts: Counter[tuple[str, str]] = Counter()
    curves: set[tuple[str, str]] = set()
    for one in ranked:
        place = one.effect.acts_on, f"{one.effect.over}*{one.effect.times}"
        if one.promise < _NEAR_THE_BEST * ranked[0].promise or counts.total() == _FITTED:
            return
        if counts[place] == _OF_ONE_PLACE or (place not in counts and len(counts) == _MOST_PLACES):
            continue
        if one.effect.is_smooth:
            if place in curves:
                continue
            curves.add(place)
        counts[place] += 1
        yield one


def _candidate(problem: Structurable, chosen: Selection, begun: Structure, looked: float) -> _Candidate | None:
    """Fit the model with a structure and return it as a candidate, if it passes the tests, else None."""
    fitted = _fitted(problem, chosen, begun)
    return None if fitted is None else _judged(problem, chosen, fitted, looked)


def _fitted(problem: Structurable, chosen: Selection, begun: Structure) -> Fit | None:
    """Fit the model with a structure; return None if it ends at a bound."""
    present = chosen.after
    # sizes and all other parameters first, with fixed places: the places are better fitted from there
    there = replace(present.point, effects=(*present.point.effects, unmoved(begun, ("shape",))))
    sized = fit(problem, chosen.whitener, there, present.fitted, rounds=_SIZED, near=present).point
    begun = type(begun).make(sized.effects[-1].values)
    start = replace(sized, effects=(*sized.effects[:-1], begun))
    held = chosen.heldout
    # an instant cannot be predicted from other steps: it is fitted to all steps, its size to those not held out
    instant = begun.over == "time" and begun.acts_on != "encoder" and bool(held.any())
    one = fit(problem, chosen.whitener, start, np.ones_like(held) if instant else present.fitted, near=present)
    added = one.point.effects[-1]
    assert isinstance(added, Structure)  # noqa: S101  # it was fitted as one
    if instant:
        then = replace(start, effects=(*start.effects[:-1], unmoved(added, ("shape",))))
        one = fit(problem, chosen.whitener, then, present.fitted, near=present)
    return None if at_bound(added) and not added.is_sharp else one


def _judged(problem: Structurable, chosen: Selection, one: Fit, looked: float) -> _Candidate | None:
    """Return the candidate if it passes the tests, also on held-out steps, else None."""
    present, held = chosen.after, chosen.heldout
    gain = gain_of(one, present)
    evidence = gain - len(one.point.effects[-1].parameters) * math.log(one.rows) - looked
    starts = block_starts(one.white.size)
    rows = one.fitted[problem.step]
    if gain / scatter((present.white - one.white) * rows, present.white * rows, starts) - looked < chosen.least:
        return None
    if held.any():
        rows = held[problem.step]
        if gain_of(one, present, held) < least_gain(one.white[rows], present.white[rows]) - _NOTHING:
            return None
    return _Candidate(fit=one, gain=gain, evidence=evidence) if evidence > 0.0 and not _cancels(problem, one) else None


def _cancels(problem: Structurable, fitted: Fit) -> bool:
    """Return whether a structure of the fit is so large that other terms have to cancel it: they are nearly the same.

    In a recording at one constant rate, for example, functions of time, angle and rate differ only by noise.
    """
    effects, used = fitted.point.effects, problem.usable
    span = float(np.ptp(problem.measured[used]))
    for structure in (one for one in effects if isinstance(one, Structure)):
        others = tuple(one for one in effects if one is not structure)
        adds = fitted.predicted - problem.predict(fitted.point.baseline, others)
        if float(np.ptp(adds[used])) > _CANCELLED * span:
            return True
    return False
