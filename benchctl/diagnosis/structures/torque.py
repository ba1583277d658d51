"""Structures of a drive's torque, searched in turn with the named effects: friction and harmonics follow many shapes.

Several harmonics can follow any peak over the angle, and an offset the far side of a step. The search therefore begins
from several sets of named effects, always with an offset: a shape is zero on one side only by convention.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from benchctl.diagnosis.drive.problem import DriveProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.residual.residual_structure import is_attributable, residual_structure_of
from benchctl.diagnosis.search.select import reduced, select, without
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.structures.search import NEARLY, Modelled, Scan, modelled, with_last
from benchctl.diagnosis.structures.settled import CLEARLY, MOST_STRUCTURES, SEVERAL, replaceable, structures_of
from benchctl.estimation.fit import fit, gain_of
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structures import Structure, on_the_other_side

_OFFSET = "torque_offset"
_PURSUED = 2
"""Number of sets of named effects, of those with the best first structure, from which the search continues."""


def torque_modelled(
    problem: DriveProblem, chosen: Selection, searched: Selection, *, left: bool, seed: int
) -> Modelled:
    """Return the best model of a torque: named effects with or without structures.

    Structures may be added to the effects or replace those along one coordinate. They must be clearly better than the
    effects alone, or leave no residual where these leave one (`left`). A residual that the model of a named effect may
    have caused is modelled only over other coordinates. The search also begins from the selection that was `searched`,
    before a residual withdrew names from it: with a structure these may be right.
    """
    rest = residual_structure_of(problem, chosen.whitener, chosen.after, seed=seed)
    names = Modelled(chosen=chosen, structures=(), ties=(), left=rest)
    starts: list[tuple[Selection, tuple[DescribedEffect, ...]]] = [(one, ()) for one in _starts(problem, chosen)]
    if searched.evidence.keys() - chosen.evidence.keys():
        starts.insert(0, (searched, ()))
    if left:
        starts.append((chosen, ()))
    elif rest.significant:
        starts.append((chosen, tuple(one for one in chosen.after.point.effects if one.identifier != _OFFSET)))
    first = [found for start, known in starts if (found := _first(problem, start, known, seed)) is not None]
    models: list[Modelled] = []
    while first and len(models) < _PURSUED:
        promising = _best(problem, *first)
        first = [one for one in first if one is not promising]
        models.append(_pursued(problem, promising, seed))
    best = _best(problem, names, *models)
    clearly = _criterion(best) < _criterion(names) - CLEARLY
    return best if clearly or (left and not best.left.significant) else names


def _starts(problem: DriveProblem, chosen: Selection) -> Iterator[Selection]:
    """Yield the selection without the named effects along one coordinate, and without all but one of them."""
    for keys, _, _ in replaceable(problem, chosen, SEVERAL):
        yield reduced(problem, chosen, keys)
        for kept in keys:
            yield reduced(problem, chosen, {*keys} - {kept})


def _first(
    problem: DriveProblem, chosen: Selection, apart_from: Sequence[DescribedEffect], seed: int
) -> Modelled | None:
    """Return the selection with the best single structure; None if no shape explains anything."""
    begun = _with_offset(problem, chosen)
    rest = residual_structure_of(problem, begun.whitener, begun.after, seed=seed)
    return modelled(problem, begun, rest, apart_from=apart_from, most=1, seed=seed) if rest.significant else None


def _with_offset(problem: DriveProblem, chosen: Selection) -> Selection:
    """Return the selection with an offset of the torque, if the problem has this effect."""
    if _OFFSET in chosen.evidence or _OFFSET not in problem.effects:
        return chosen
    point = chosen.after.point
    offset = problem.effects[_OFFSET].make({"offset_nm": 0.0})
    return with_last(problem, chosen, replace(point, effects=(*point.effects, offset)))


def _pursued(problem: DriveProblem, first: Modelled, seed: int) -> Modelled:
    """Continue from the first structure: with the named effects found after each further structure, or after the last.

    The first terms also follow what is still missing. The structures are therefore searched again with all effects,
    then the effects with these structures.
    """
    found = _with_names(problem, first, seed)
    for _ in range(MOST_STRUCTURES - 1):
        more = _extended(problem, found, 1, seed)
        if more is None:
            break
        found = _with_names(problem, more, seed)
    alone = _extended(problem, first, MOST_STRUCTURES - 1, seed)
    if alone is not None:
        found = _best(problem, found, _with_names(problem, alone, seed))
    names = _with_offset(problem, reduced(problem, found.chosen, structures_of(found.chosen)))
    rest = residual_structure_of(problem, names.whitener, names.after, seed=seed)
    scan = Scan(problem, names)
    for smooth in (False, True):
        if smooth and not _misses(problem, found):
            break
        anew = modelled(problem, names, rest, most=MOST_STRUCTURES, smooth=smooth, scan=scan, seed=seed)
        if anew is not None:
            found = _best(problem, found, _with_names(problem, anew, seed))
    return _best(problem, found, *_without_offset(problem, found, seed))


def _extended(problem: DriveProblem, found: Modelled, most: int, seed: int) -> Modelled | None:
    """Return the model with at most `most` further structures; None if no shape explains anything."""
    chosen = found.chosen
    if not found.left.significant:
        return None
    bare = without(problem, chosen, *structures_of(chosen))
    more = modelled(problem, chosen, found.left, most=most, bare=bare, seed=seed)
    return None if more is None else replace(more, structures=(*found.structures, *more.structures))


def _without_offset(problem: DriveProblem, found: Modelled, seed: int) -> Iterator[Modelled]:
    """Yield the model without its offset, and with each one-sided structure on its other side in the place of both."""
    if _OFFSET not in found.chosen.evidence:
        return
    named = zip(found.chosen.evidence, found.chosen.after.point.effects, strict=True)
    effects = tuple(effect for key, effect in named if key != _OFFSET)
    less = reduced(problem, found.chosen, {_OFFSET})

    def model_of(chosen: Selection) -> Modelled:
        left = residual_structure_of(problem, chosen.whitener, chosen.after, seed=seed)
        structures = tuple(one for one in chosen.after.point.effects if isinstance(one, Structure))
        return replace(found, chosen=chosen, structures=structures, left=left)

    yield model_of(less)
    for place, effect in enumerate(effects):
        other = on_the_other_side(effect) if isinstance(effect, Structure) else None
        if other is None:
            continue
        turned = (*effects[:place], other, *effects[place + 1 :])
        after, full = (
            fit(problem, less.whitener, replace(one.point, effects=turned), one.fitted)
            for one in (less.after, less.full)
        )
        evidence = dict(zip(keys_of(turned), less.evidence.values(), strict=True))
        yield model_of(replace(less, after=after, full=full, evidence=evidence))


def _best(problem: DriveProblem, *models: Modelled) -> Modelled:
    """Return the model with the fewest parameters that explains nearly as much as any and leaves no residual.

    If all leave one, return the model with the lowest criterion.
    """
    complete = [one for one in models if not _misses(problem, one)]
    if not complete:
        return min(models, key=_criterion)
    most = max(_explained(one) for one in complete)
    simple = [one for one in complete if _explained(one) >= most - (1.0 - NEARLY) * abs(most)]
    return min(simple, key=lambda one: (len(one.chosen.after.numbers), _criterion(one)))


def _explained(found: Modelled) -> float:
    """Return what a model gains over the baseline alone, in twice the log likelihood."""
    chosen = found.chosen
    return chosen.after.rows * math.log(chosen.before.squares / chosen.after.squares)


def _misses(problem: DriveProblem, found: Modelled) -> bool:
    """Return whether a model leaves a residual, apart from one so small that an inexact shape may have caused it."""
    if not found.left.significant:
        return False
    bare = without(problem, found.chosen, *structures_of(found.chosen))
    return not is_attributable(found.left, gain_of(found.chosen.after, bare))


def _with_names(problem: DriveProblem, found: Modelled, seed: int) -> Modelled:
    """Return the model with the named effects found with its structures, and without redundant structures."""
    known = structures_of(found.chosen)
    if len({*known.values()}) < len(known):  # a search cannot distinguish two of a kind
        return found
    again = select(problem, seed=seed, progress=lambda _name, _share: None, chosen=found.chosen)
    kept = tuple(one for one in found.structures if one.identifier in structures_of(again).values())
    left = residual_structure_of(problem, again.whitener, again.after, seed=seed)
    extended = Modelled(chosen=again, structures=kept, ties=found.ties if kept else (), left=left)
    return _best(problem, found, extended)


def _criterion(found: Modelled) -> float:
    """Return Schwarz's criterion (BIC) of a model; lower is better."""
    after = found.chosen.after
    return after.rows * math.log(after.squares) + len(after.numbers) * math.log(after.rows)
