"""Named effects together with structures: removes effects that were found only in place of a structure."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.residual.residual_structure import residual_structure_of
from benchctl.diagnosis.residual.score_test import ScoreTest
from benchctl.diagnosis.search.select import reduced, without
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.structures.scan import Structurable
from benchctl.diagnosis.structures.search import Modelled, Scan, modelled
from benchctl.estimation.fit import Point, fit, gain_of
from benchctl.estimation.noise import Noisy
from benchctl.estimation.noise_model import NoiseModel
from benchctl.estimation.wandering import PROCESSES
from benchctl.signals.binning import hats
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.kinds import ClockEffect, FilterEffect
from benchctl_instruments.physics.structure_places import ACTS
from benchctl_instruments.physics.structures import Structure, freed

CLEARLY = 20.0
"""Minimum advantage of a structure over named effects, in twice the log likelihood less the price of parameters."""

_CLEARLY_LESS = 0.5
"""Structures with more parameters than the named effects must reduce the residual power by this factor."""

_OF_THE_RATE = {"output": "rate", "abs_rate": "rate"}
"""Coordinates that count as the same: a function of the rate is nearly a function of the output."""

MOST_STRUCTURES, _BEGUN = 3, 0.3
"""Maximum number of structures; minimum gain of the first one relative to what it replaces."""

_UNREFINED = 0.98
"""Minimum share of the final gain of a structure that it has before its widths are refined."""

_PIECES = (24, 48, 96)
"""Numbers of linear pieces over each of two coordinates; over one coordinate twice as many."""

SEVERAL = 2
"""Minimum number of structures at one stage and coordinate that a single curve may replace."""
_NEARLY_ALL = 0.98
"""A process can follow anything slow: a structure with this share of its gain replaces it."""


def settled(problem: Structurable, chosen: Selection) -> Selection:
    """Return the selection without findings whose gain is too small with its structures, and with the noise remeasured.

    In the fit to all steps, all parameters of the structures are free; their values are reported.
    """
    while (needless := _needless(problem, chosen)) is not None:
        chosen = reduced(problem, chosen, {needless})
    if chosen.noise.found:
        noise = chosen.noise.measured(problem, chosen.after, least_gain=chosen.least)
        chosen = _under(problem, chosen, noise)
    held = chosen.full.point.effects
    free = tuple(freed(one) if isinstance(one, Structure) else one for one in held)
    if [*map(type, free)] != [*map(type, held)]:
        full = fit(problem, chosen.whitener, replace(chosen.full.point, effects=free), chosen.full.fitted)
        chosen = replace(chosen, full=full)
    point = chosen.after.point
    named = tuple(effect for effect in point.effects if not isinstance(effect, Structure))
    bare = fit(problem, chosen.whitener, Point(baseline=point.baseline, effects=named), chosen.after.fitted)
    return replace(chosen, named=bare)


def structures_of(chosen: Selection) -> dict[str, str]:
    """Return the identifiers of the structures of a selection, by key."""
    effects = chosen.after.point.effects
    named = zip(keys_of(effects), effects, strict=True)
    return {key: one.identifier for key, one in named if isinstance(one, Structure)}


def _needless(problem: Structurable, chosen: Selection) -> str | None:
    effects = chosen.after.point.effects
    delayed = any(isinstance(one, Structure) and one.acts_on == "sampling" for one in effects)
    for key, effect in zip(keys_of(effects), effects, strict=True):
        if isinstance(effect, Structure) or (isinstance(effect, ClockEffect | FilterEffect) and not delayed):
            continue
        if gain_of(chosen.after, without(problem, chosen, key)) < chosen.least:
            return key
    return None


def instead_of_names(
    problem: GyroProblem, chosen: Selection, *, left: bool, seed: int
) -> tuple[Selection, Modelled] | None:
    """Return a structure that replaces several findings along one coordinate, or a wandering bias, if it is better.

    It must have fewer parameters than the findings together. A single finding that leaves a residual (`left`) is
    replaced by a structure that leaves none. The first value is the selection without the findings. Return None if
    there are no such findings or if they are as good.
    """
    for keys, parameters, gain in replaceable(problem, chosen, 1 if left else 2):
        less = reduced(problem, chosen, keys)
        if keys[0] in PROCESSES:
            found = _instead_of_process(problem, less, gain, seed)
            if found is not None:
                return less, found
            continue
        least = gain + CLEARLY - (parameters - 1) * math.log(chosen.after.rows)  # of a structure with one parameter
        worth = max(_BEGUN * gain, _UNREFINED * least)
        found = modelled(problem, less, None, most=1, worth=worth, seed=seed)
        if found is None:
            continue
        fewer = parameters - sum(len(one.parameters) for one in found.structures)
        gained = gain_of(found.chosen.after, less.after)
        if gained - gain + fewer * math.log(chosen.after.rows) > CLEARLY and (
            fewer > 0 if len(keys) > 1 else not found.left.significant
        ):
            return less, found
    return None


def names_do_better(problem: GyroProblem, names: Selection, instead: Selection, *, seed: int) -> bool:
    """Return whether findings are better on held-out steps than their replacement: structures, or nothing.

    Findings are dropped if a structure may be the cause. They are kept if the replacement leaves a larger residual
    beyond the noise; a replacement with more parameters must leave a clearly smaller one.
    """
    if not residual_structure_of(problem, instead.whitener, instead.after, seed=seed).significant:
        return False
    deciding = names.heldout if names.heldout.any() else ~names.heldout

    def left(one: Selection) -> float:
        rows = deciding[problem.step] & (one.whitener.weight > 0.0)
        noise = min(names.noise.level, instead.noise.level)
        return max(float(np.sum(one.after.residual[rows] ** 2 - noise**2)), 0.0)

    simpler = len(names.after.numbers) < len(instead.after.numbers)
    return (_CLEARLY_LESS if simpler else 1.0) * left(names) < left(instead)


def _instead_of_process(problem: GyroProblem, less: Selection, gain: float, seed: int) -> Modelled | None:
    """Return structures that explain more than a process of this `gain`, alone or with a smaller process.

    A process can follow anything slow, and structures can follow a process. Structures are therefore added one by one,
    and each one, with the remaining process, must gain more than the last. A residual that does not wander is not a
    process; then structures are used alone, even if no shape fits exactly. None if the process alone is as good.
    """
    wandering = _wanders(problem, less, gain)
    best: tuple[float, Modelled] | None = None
    chosen, rest = less, residual_structure_of(problem, less.whitener, less.after, seed=seed)
    structures: tuple[Structure, ...] = ()
    for _ in range(MOST_STRUCTURES):
        worth = _BEGUN * gain if wandering and not structures else 0.0
        bare = less.after if structures else None
        found, scan = None, Scan(problem, chosen)
        if rest.significant:
            found = modelled(problem, chosen, rest, most=1, worth=worth, bare=bare, scan=scan, seed=seed)
        if found is None and rest.significant and not (wandering or structures):
            found = modelled(problem, chosen, rest, most=1, smooth=True, scan=scan, seed=seed)
        if found is None:
            break
        chosen, rest, structures = found.chosen, found.left, (*structures, *found.structures)
        numbers = sum(len(one.parameters) for one in structures)
        gained = gain_of(chosen.after, less.after) - numbers * math.log(less.after.rows)
        process = chosen.noise.wandering(problem, chosen.after, chosen.least)
        found = replace(found, structures=structures)
        if gained > _NEARLY_ALL * gain and (process is None or process.gain < (1.0 - _NEARLY_ALL) * gained):
            return found
        total = gained + (0.0 if process is None else process.gain)
        if wandering and total < gain + CLEARLY:
            continue
        if process is None or not _wanders(problem, chosen, process.gain):
            best = total, found
        elif best is None or total > best[0]:
            best = total, _with_process(problem, found, process, seed)
    return None if best is None else best[1]


def _wanders(problem: GyroProblem, without: Selection, gain: float) -> bool:
    """Return whether the signal that a process of this `gain` follows is not a function of time or of temperature.

    A function of time, or of the temperature and its rate, is explained better by a piecewise linear function than by
    a process, which predicts a row only from earlier rows. A function of the temperature is explained better by pieces
    over temperature than by equally many over time. A wandering signal is explained best by the process; few pieces may
    by chance follow it better over temperature than over time, many do not.
    """
    fitted, weight = without.after, without.whitener.weight
    left = ScoreTest(fitted.white, fitted.derivatives, fitted.fitted[problem.step] & (weight > 0.0))

    def evidence(names: Sequence[str], pieces: int) -> float:
        lines = [_lines_along(problem.coordinates[name], pieces, weight) for name in names]
        tested = left.score(scipy.sparse.hstack(lines).tocsr())
        return tested.gain - tested.dof * math.log(left.freedom)

    by_temperature = {pieces: evidence(("gyro_temp", "gyro_temp_rate"), pieces) for pieces in _PIECES}
    by_time = {pieces: evidence(("time",), 2 * pieces) for pieces in _PIECES}
    if all(by_temperature[pieces] > by_time[pieces] for pieces in _PIECES):
        return False
    return max(*by_temperature.values(), *by_time.values()) < gain


def _lines_along(values: FloatArray, pieces: int, weight: FloatArray) -> scipy.sparse.csr_array:
    counted = values[weight > 0.0]
    return hats(values, np.linspace(counted.min(), counted.max(), pieces + 1), weight)


def _with_process(problem: GyroProblem, found: Modelled, process: Noisy, seed: int) -> Modelled:
    """Return the structures with a process added to the noise model, all refitted."""
    chosen = _under(problem, found.chosen, found.chosen.noise.with_(process))
    return replace(found, chosen=chosen, left=residual_structure_of(problem, chosen.whitener, chosen.after, seed=seed))


def leaving_out(problem: GyroProblem, chosen: Selection, rows: BoolArray) -> Selection:
    """Return a selection refitted without the rows of a mask, shape (n,)."""
    return _under(problem, chosen, chosen.noise.leaving_out(rows))


def _under(problem: Structurable, chosen: Selection, noise: NoiseModel) -> Selection:
    """Return a selection refitted with another noise model."""
    after, full = (fit(problem, noise.whitener, one.point, one.fitted) for one in (chosen.after, chosen.full))
    return replace(chosen, noise=noise, after=after, full=full)


def as_one_curve(problem: Structurable, found: Modelled, seed: int) -> Modelled:
    """Replace several structures over one coordinate, and named effects along it, by one smooth curve.

    The curve may not leave a larger residual. It is preferred because several shapes are not simpler than one curve.
    """
    effects = dict(zip(keys_of(found.chosen.after.point.effects), found.chosen.after.point.effects, strict=True))
    structures = {key: one for key, one in effects.items() if isinstance(one, Structure) and one.pointwise}
    places = Counter((one.acts_on, _same(one.over)) for one in structures.values() if not one.times)
    for (stage, over), count in places.items():
        if count < SEVERAL or stage == "encoder":
            continue
        shapes = [key for key, one in structures.items() if (one.acts_on, _same(one.over)) == (stage, over)]
        names = [
            key
            for key, one in effects.items()
            if isinstance(one, PhysicalEffect) and not isinstance(one, Structure) and _same(one.coordinate) == over
            # a bias that is odd in the rate equals a scale factor that is even in it
            if over == "rate" or one.stage == ACTS[stage].chain
        ]
        less = reduced(problem, found.chosen, {*shapes, *names})
        rest = residual_structure_of(problem, less.whitener, less.after, seed=seed)
        curve = modelled(problem, less, rest, most=1, smooth=True, seed=seed)
        if curve is None or (curve.structures[0].acts_on, _same(curve.structures[0].over)) != (stage, over):
            continue
        if curve.left.significant and not (found.left.significant and curve.left.power < found.left.power):
            continue
        kept = {effects[key].identifier for key in structures.keys() - {*shapes}}
        others = tuple(one for one in found.structures if one.identifier in kept)
        return replace(curve, structures=(*curve.structures, *others))
    return found


def _same(coordinate: str) -> str:
    """Return the coordinate, or the equivalent one, without `rate`, which is due to the scale factor."""
    words = [word for word in coordinate.split("*") if word != "rate"] or ["rate"]
    return "*".join(_OF_THE_RATE.get(word, word) for word in words)


def replaceable(problem: Structurable, chosen: Selection, fewest: int) -> Iterator[tuple[tuple[str, ...], int, float]]:
    """Yield the keys, number of parameters and gain of at least `fewest` findings along one coordinate.

    A wandering bias follows with one parameter. Delays and filters are excluded: a function of the acceleration is
    equivalent to them at a single frequency only.
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
