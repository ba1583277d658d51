"""Models for what has no name: of the residual's coordinates the simplest shape that explains it.

What a fit leaves was found model-free (`rest`), which also sets the ceiling. Here shapes over all coordinates are
fitted like effects, jointly with the baseline and the findings, and compared by evidence, which pays for each parameter
(Schwarz, Annals of Statistics 6, 1978) and every place that was looked at; steps that nothing was fitted to decide.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.residual.residual_structure import ResidualStructure, is_owed, residual_structure_of
from benchctl.diagnosis.search.held_out import least_gain
from benchctl.diagnosis.search.models import IMPERFECT
from benchctl.diagnosis.search.pull import pull_of
from benchctl.diagnosis.search.scans import clock_s
from benchctl.diagnosis.search.scatter import scatter
from benchctl.diagnosis.search.select import reduced
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.diagnosis.structures.scan import Begun, Structurable, begun_everywhere, encoder_jumps
from benchctl.estimation.fit import Fit, Point, fit, gain_of
from benchctl.estimation.point import at_bound
from benchctl.signals.blocks import block_starts
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structure_shapes import SHAPES
from benchctl_instruments.physics.structures import Structure, unmoved

_NEAR_THE_BEST = 0.4
"""Share of the best promise below which a shape is not fitted."""
_REFINED, _FITTED, _OF_ONE_PLACE, _MOST_PLACES = 30, 6, 3, 4
"""Of so many shapes the place is refined; so many are fitted, at one place so many, at so many of these."""
_SIZED = 2
_SHARPER = (0.2, 0.2)
_NOTHING = 1e-3
"""A loss on held-out steps in which a structure does not show."""
_KINDS = {
    "gyro_temp": "temperature",
    "gyro_temp_rate": "temperature",
    "chamber_temp": "temperature",
    "setpoint": "temperature",
    "angle": "angle",
    "time": "time",
}
_MOTION = "motion"
NEARLY = 0.97
"""Share of the best gain that a simpler shape over the same coordinate must reach."""
_TIE = 10.0
"""In twice the log likelihood: two coordinates whose models differ by less are not told apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Modelled:
    """A selection with structures in its model, and by coordinate what else would explain the first as well."""

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
    rest: ResidualStructure,
    *,
    apart_from: Sequence[DescribedEffect] = (),
    most: int = 3,
    smooth: bool = False,
    worth: float = 0.0,
    bare: Fit | None = None,
    seed: int,
) -> Modelled | None:
    """The selection with what is left modelled by at most so many structures; None where no shape explains it.

    Shapes over coordinates along which one of the effects `apart_from` acts are not tried, and smooth curves only where
    they are asked for, one over coordinates of a kind: together they would follow anything. The first must gain what it
    is `worth`. What is little beside what was found, and may be what its shape misses, is not modelled; `bare` is the
    fit without structures where some are in the selection.
    """
    taken = {_kind(word) for effect in apart_from for word in _own(effect.coordinate)}
    found: list[Structure] = []
    ties: tuple[str, ...] = ()
    known = [one for one in chosen.after.point.effects if isinstance(one, Structure)] if bare is not None else []
    bare = chosen.after if bare is None else bare
    for _ in range(2 * most):  # of which some make others needless
        if len(found) == most or not rest.significant:
            break
        before = [*known, *found]
        explained = gain_of(chosen.after, bare) if before else 0.0
        owed = bool(before) and is_owed(rest, max(explained, _as_gain(chosen, bare, rest)))
        curved = {_kind(one.over) for one in before if one.is_smooth} if smooth else {*_KINDS.values(), _MOTION}
        ruled_out = taken | (_followed(before) if owed else set())
        candidates = _candidates(problem, chosen, ruled_out, curved, IMPERFECT**2 * explained)
        if not candidates or (not found and max(one.gain for one in candidates) < worth):
            break
        best = _sharpened(problem, chosen, _simple_enough(problem, chosen, candidates, seed))
        ties = ties if found else _tied(best, candidates)
        chosen = _with(problem, chosen, best.fit)
        first = found[:1]
        if any(type(one) is type(best.structure) for one in found):  # keys do not tell two of a kind apart
            found = [*found, best.structure]
        else:
            chosen, found = _pruned(problem, chosen, found, best.structure)
        ties = ties if not first or found[0] is first[0] else ()
        rest = residual_structure_of(problem, chosen.whitener, chosen.after, seed=seed)
    if not found:
        return None
    return Modelled(chosen=chosen, structures=tuple(found), ties=ties, left=rest)


def _simple_enough(problem: Structurable, chosen: Selection, candidates: Sequence[_Candidate], seed: int) -> _Candidate:
    """Of the models over the coordinate that explains most the simplest, where it leaves no more than the best one."""
    best = max(candidates, key=lambda one: one.evidence)
    if best.structure.over == "output":  # which is nearly the rate, of which more is a function
        rates = [one for one in candidates if one.structure.over == "rate"]
        nearest = max(rates, key=lambda one: one.evidence, default=best)
        best = nearest if nearest.evidence > best.evidence - _TIE else best
    best = _at_one_value(best, candidates)
    simple = _simplest(best, candidates)
    better = max((one for one in candidates if _alike(one, best)), key=lambda one: one.evidence)
    if simple is better:
        return simple
    with_simple = _with(problem, chosen, simple.fit)
    left = residual_structure_of(problem, with_simple.whitener, with_simple.after, seed=seed)
    return better if left.significant else simple


def _tied(best: _Candidate, candidates: Sequence[_Candidate]) -> tuple[str, ...]:
    """Other coordinates over which a structure explains as much."""
    most = max(candidates, key=lambda one: one.evidence)
    words = dict.fromkeys(one.structure.word for one in candidates if one.evidence > most.evidence - _tie(most))
    return tuple(word for word in words if word != best.structure.word)


def _as_gain(chosen: Selection, bare: Fit, rest: ResidualStructure) -> float:
    """The power that structures explain, scaled like the gain of what is left; a log likelihood understates it."""
    counted = chosen.whitener.weight > 0.0
    explained = float(np.mean(bare.residual[counted] ** 2 - chosen.after.residual[counted] ** 2))
    return rest.gain * explained / max(rest.power, 1e-300)


def _pruned(
    problem: Structurable, chosen: Selection, found: list[Structure], last: Structure
) -> tuple[Selection, list[Structure]]:
    """The selection, and the structures in it, without those that the last one has made needless."""
    kept = found
    for one in found:
        less = reduced(problem, chosen, {one.identifier})
        if gain_of(chosen.after, less.after) < chosen.least + len(one.parameters) * math.log(chosen.after.rows):
            chosen, kept = less, [other for other in kept if other is not one]
    return chosen, [*kept, last]


def _simplest(best: _Candidate, candidates: Sequence[_Candidate]) -> _Candidate:
    """The shape of fewest numbers that explains nearly as much as the best, at its stage over its coordinate."""
    alike = [one for one in candidates if _alike(one, best)]
    most = max(one.gain for one in alike)
    return min(
        (one for one in alike if one.gain > NEARLY * most),
        key=lambda one: (len(one.structure.parameters), -one.evidence),
    )


def _at_one_value(best: _Candidate, candidates: Sequence[_Candidate]) -> _Candidate:
    """Instead of two instants the one value of another coordinate that explains as much: no coincidence is needed."""
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
    """How much less evidence a model may have and still tie with the best one, which may miss as much itself."""
    return max(_TIE, IMPERFECT**2 * best.gain)


def _values(structure: Structure) -> int:
    """At how many values of its coordinate something happens."""
    shape = SHAPES[structure.shape]
    return len({*shape.places, *shape.lengths} - {"width"})


def _alike(one: _Candidate, other: _Candidate) -> bool:
    """Whether two act at one stage over one coordinate."""
    mine, its = one.structure, other.structure
    return (mine.acts_on, mine.over, mine.times) == (its.acts_on, its.over, its.times)


def _sharpened(problem: Structurable, chosen: Selection, best: _Candidate) -> _Candidate:
    """A step with a narrower width where that is better: a fit does not see edges that lie between its rows."""
    for share in _SHARPER if "width" in best.structure.values and best.structure.is_stepped else ():
        values = best.structure.values
        begun = type(best.structure).make({**values, "width": share * values["width"]})
        one = _fitted(problem, chosen, begun, 0.0)
        if one is None or one.gain <= best.gain:
            break
        best = replace(one, evidence=best.evidence + one.gain - best.gain)
    return best


def with_jumps(problem: GyroProblem, chosen: Selection) -> tuple[Selection, tuple[Structure, ...]]:
    """The selection with the jumps of the encoder that the data demand, and these; a rest need not show them.

    No other step foretells a jump: one in a step that was held out is looked for, and fitted, there.
    """
    found: list[Structure] = []
    looked = 2.0 * math.log(chosen.after.rows)
    clock = clock_s(problem)
    for begun in encoder_jumps(problem, pull_of(problem, chosen.whitener, chosen.whole), chosen.noise.pure_error):
        step = int(problem.step[min(int(np.searchsorted(clock, begun.values["at"])), clock.size - 1)])
        if chosen.heldout[step]:
            held = _with_jump_held_out(problem, chosen, begun, looked)
            if held is not None:
                chosen = held
                found.append(begun)
            continue
        one = _fitted(problem, chosen, begun, looked)
        if one is not None:
            chosen = _with(problem, chosen, one.fit)
            found.append(one.structure)
    return chosen, tuple(found)


def _with_jump_held_out(problem: GyroProblem, chosen: Selection, begun: Structure, looked: float) -> Selection | None:
    everything = chosen.whole
    point = replace(everything.point, effects=(*everything.point.effects, begun))
    whole = fit(problem, chosen.whitener, point, everything.fitted)
    if gain_of(whole, everything) - looked < chosen.least or at_bound(whole.point.effects[-1]):
        return None
    added = whole.point.effects[-1]
    assert isinstance(added, Structure)  # noqa: S101  # it was fitted as one
    point = replace(chosen.after.point, effects=(*chosen.after.point.effects, unmoved(added)))
    after = fit(problem, chosen.whitener, point, chosen.after.fitted)
    return replace(_with(problem, chosen, after), whole=whole)


def _with(problem: Structurable, chosen: Selection, after: Fit) -> Selection:
    """The selection with a structure as the last effect of its model; it was fitted by derivatives that nearly hold."""
    after = fit(problem, chosen.whitener, after.point, after.fitted)
    effects = (*chosen.whole.point.effects, after.point.effects[-1])
    everything = np.ones_like(after.fitted)
    whole = after
    if chosen.heldout.any():
        whole = fit(problem, chosen.whitener, Point(baseline=after.point.baseline, effects=effects), everything)
    gone = chosen.after
    evidence = Evidence(
        gain=gain_of(after, gone),
        heldout=gain_of(after, gone, chosen.heldout),
        scatter=1.0,
        excess=(gone.white**2 - after.white**2).astype(np.float32),
    )
    key = keys_of(after.point.effects)[-1]
    return replace(chosen, after=after, whole=whole, evidence={**chosen.evidence, key: evidence})


def _kind(word: str) -> str:
    """What a coordinate is of: motion, temperature, angle, time."""
    return _KINDS.get(word, _MOTION)


def _followed(found: Sequence[Structure]) -> set[str]:
    """Kinds of coordinates over which what the shapes of structures miss may show; a temperature follows the time."""
    kinds = {_kind(word) for one in found for word in one.word.split("*")}
    return kinds | ({"temperature", "time"} if kinds & {"temperature", "time"} else set())


def _own(coordinate: str) -> list[str]:
    """The words of a coordinate; of two without the rate, in proportion to which a scale factor acts."""
    words = coordinate.split("*")
    return [word for word in words if word != "rate"] or words


def _candidates(
    problem: Structurable, chosen: Selection, taken: set[str], curved: set[str], missed: float
) -> list[_Candidate]:
    """Models with one structure more that hold on steps which they were not fitted to.

    None over coordinates of the kinds that are `taken`, and no smooth curve over those that are `curved`. So much of
    what one gains may be what the structures before it have `missed`.
    """
    pulls = (pull_of(problem, chosen.whitener, one) for one in (chosen.after, chosen.whole))
    begun = begun_everywhere(problem, *pulls)
    begun = [one for one in begun if _kind(one.effect.over) not in taken | (curved if one.effect.is_smooth else set())]
    looked = 2.0 * math.log(max(sum(one.places for one in begun), 1.0)) + missed
    price = math.log(chosen.after.rows)

    def worth(one: Begun) -> float:
        return one.promise - len(one.effect.parameters) * price

    best = sorted(begun, key=worth, reverse=True)[:_REFINED]
    ranked = sorted((one.refined() for one in best), key=worth, reverse=True)
    fitted = (_fitted(problem, chosen, one.effect, looked) for one in few_of_each(ranked))
    return [one for one in fitted if one is not None]


def few_of_each(ranked: Sequence[Begun]) -> Iterator[Begun]:
    """The most promising, at one place only some, of smooth curves one; none that promises far less than the best."""
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


def _fitted(problem: Structurable, chosen: Selection, begun: Structure, looked: float) -> _Candidate | None:
    """The model with a structure; None where it does not pass, also on steps that were held out."""
    present = chosen.after
    # sizes and everything beside them first: a place found among all is better than one that follows them there
    there = replace(present.point, effects=(*present.point.effects, unmoved(begun, ("shape",))))
    sized = fit(problem, chosen.whitener, there, present.fitted, rounds=_SIZED, near=present).point
    begun = type(begun).make(sized.effects[-1].values)
    start = replace(sized, effects=(*sized.effects[:-1], begun))
    held = chosen.heldout
    # no other step foretells an instant: all steps say when it is, those that were not held out how much it changes
    instant = begun.over == "time" and begun.acts_on != "encoder" and bool(held.any())
    one = fit(problem, chosen.whitener, start, np.ones_like(held) if instant else present.fitted, near=present)
    added = one.point.effects[-1]
    assert isinstance(added, Structure)  # noqa: S101  # it was fitted as one
    if instant:
        then = replace(start, effects=(*start.effects[:-1], unmoved(added, ("shape",))))
        one = fit(problem, chosen.whitener, then, present.fitted, near=present)
    if at_bound(added) and not added.is_sharp:
        return None
    gain = gain_of(one, present)
    evidence = gain - len(begun.parameters) * math.log(one.rows) - looked
    starts = block_starts(one.white.size)
    rows = one.fitted[problem.step]
    if gain / scatter((present.white - one.white) * rows, present.white * rows, starts) - looked < chosen.least:
        return None
    if held.any():
        rows = held[problem.step]
        if gain_of(one, present, held) < least_gain(one.white[rows], present.white[rows]) - _NOTHING:
            return None
    return _Candidate(fit=one, gain=gain, evidence=evidence) if evidence > 0.0 else None
