"""Named effects beside structures: what was found before a structure, and stood for it, is not stated beside it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from benchctl.diagnosis.fitting.fit import Point, fit, gain_of
from benchctl.diagnosis.fitting.wandering import PROCESSES
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.rest.rest import rest_of
from benchctl.diagnosis.search.select import reduced, without
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.structures.search import Modelled, modelled
from benchctl_instruments.physics.effects.kinds import ClockEffect, FilterEffect
from benchctl_instruments.physics.structures import Structure, freed

_CLEARLY = 20.0
"""In twice the log likelihood, beyond what its parameters cost: by that much a structure must be better than names."""

_OF_THE_RATE = {"output": "rate", "abs_rate": "rate"}
"""Coordinates that are one: what is a function of the rate is nearly one of the output."""

_STEPS, _BEGUN = 3, 0.3
"""So many structures may take the place of a process, where the first of them gains such a share of what it does."""

_NEARLY_ALL = 0.98
"""A process follows anything slow: a structure that explains nearly as much takes its place."""


def settled(problem: GyroProblem, chosen: Selection) -> Selection:
    """The selection without findings that gain too little beside its structures, its noise measured beside them.

    Fitted to all steps, the structures are free in all their numbers: these are what is stated.
    """
    while (needless := _needless(problem, chosen)) is not None:
        chosen = reduced(problem, chosen, {needless})
    if chosen.noise.found:
        noise = chosen.noise.measured(problem, chosen.after, least_gain=chosen.least)
        after, whole = (fit(problem, noise.whitener, one.point, one.fitted) for one in (chosen.after, chosen.whole))
        chosen = replace(chosen, noise=noise, after=after, whole=whole)
    held = chosen.whole.point.effects
    free = tuple(freed(one) if isinstance(one, Structure) else one for one in held)
    if [*map(type, free)] != [*map(type, held)]:
        whole = fit(problem, chosen.whitener, replace(chosen.whole.point, effects=free), chosen.whole.fitted)
        chosen = replace(chosen, whole=whole)
    point = chosen.after.point
    named = tuple(effect for effect in point.effects if not isinstance(effect, Structure))
    bare = fit(problem, chosen.whitener, Point(baseline=point.baseline, effects=named), chosen.after.fitted)
    return replace(chosen, named=bare)


def _needless(problem: GyroProblem, chosen: Selection) -> str | None:
    effects = chosen.after.point.effects
    for key, effect in zip(keys_of(effects), effects, strict=True):
        if isinstance(effect, Structure | ClockEffect | FilterEffect):
            continue
        if gain_of(chosen.after, without(problem, chosen, key)) < chosen.least:
            return key
    return None


def instead_of_names(
    problem: GyroProblem, chosen: Selection, *, left: bool, seed: int
) -> tuple[Selection, Modelled] | None:
    """A structure in the place of several findings along one coordinate, or of a wandering bias, where it is better.

    It must have fewer parameters than the findings have together; one finding beside which something is `left` gives
    way to a structure beside which nothing is. Beside it comes the selection without them. None where there are no such
    findings, or they do as well.
    """
    for keys, parameters, gain in _replaceable(problem, chosen, 1 if left else 2):
        less = reduced(problem, chosen, keys)
        rest = rest_of(problem, less.whitener, less.after, seed=seed)
        process = keys[0] in PROCESSES
        found = modelled(problem, less, rest, most=_STEPS if process else 1, worth=_BEGUN * gain, seed=seed)
        if found is None:
            continue
        numbers = sum(len(one.parameters) for one in found.structures)
        fewer = parameters - numbers
        gained = gain_of(found.chosen.after, less.after)
        if process:
            if gained - numbers * math.log(less.after.rows) > _NEARLY_ALL * gain:
                return less, found
        elif gained - gain + fewer * math.log(chosen.after.rows) > _CLEARLY and (
            fewer > 0 if len(keys) > 1 else not found.left.significant
        ):
            return less, found
    return None


def _replaceable(problem: GyroProblem, chosen: Selection, fewest: int) -> Iterator[tuple[tuple[str, ...], int, float]]:
    """Keys of so many findings along one coordinate, their parameters and gain; and of a wandering bias, which has one.

    A delay and a filter are not among them: a function of the acceleration does the same at one frequency only.
    """
    found = zip(chosen.evidence, chosen.after.point.effects, strict=True)
    effects = {key: effect for key, effect in found if not isinstance(effect, ClockEffect | FilterEffect)}
    along = {key: _OF_THE_RATE.get(effect.coordinate, effect.coordinate) for key, effect in effects.items()}
    for coordinate in sorted(set(along.values())):
        keys = tuple(key for key, its in along.items() if its == coordinate)
        if len(keys) >= fewest:
            gain = gain_of(chosen.after, without(problem, chosen, *keys))
            yield keys, sum(len(effects[key].parameters) for key in keys), gain
    for name, noisy in chosen.noise.found.items():
        if name in PROCESSES:
            yield (name,), 1, noisy.gain
