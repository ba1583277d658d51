"""Structures as a diagnosis reports them: sentence, formula, parameters with intervals, and possible causes."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchctl.diagnosis.chamber.problem import ChamberProblem
from benchctl.diagnosis.drive.problem import DriveProblem
from benchctl.diagnosis.findings.findings import estimates_of
from benchctl.diagnosis.gyro.frame import turned_unseen
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.residual.attribution import NOTHING
from benchctl.diagnosis.residual.residual_structure import ResidualStructure, is_attributable, residual_structure_of
from benchctl.diagnosis.result import Curve, Estimate, StructureModel, Unexplained
from benchctl.diagnosis.search.scans import swinging_hz
from benchctl.diagnosis.search.select import reduced, select
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.diagnosis.structures.heat import disturbed_residual, heat_modelled
from benchctl.diagnosis.structures.noise import NoiseFound, noise_structure, with_noise
from benchctl.diagnosis.structures.scan import Structurable, coordinates_of, factors_of
from benchctl.diagnosis.structures.search import Modelled, Scan, kind_of, modelled, with_jumps
from benchctl.diagnosis.structures.settled import (
    CLEARLY,
    as_one_curve,
    instead_of_names,
    leaving_out,
    settled,
    structures_of,
)
from benchctl.diagnosis.structures.torque import torque_modelled
from benchctl.estimation.fit import gain_of
from benchctl.signals.binning import bin_of
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.physics.structure_places import ACTS, PHRASES
from benchctl_instruments.physics.structure_shapes import SHAPES
from benchctl_instruments.physics.structures import Structure

_HINTS: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("scale", "gyro_temp"): ("a mode hop of the source", "a change of range", "a polariser or glue at its transition"),
    ("scale", "gyro_temp_rate"): ("a coil that is not at its thermistor's temperature", "stress while it warms"),
    ("scale", "time"): ("ageing of the source", "a supply or reference that steps", "a mount that settles"),
    ("scale", "angle"): ("the table's own rate within a turn", "an encoder error"),
    ("scale", "acceleration"): ("a delay between gyro and encoder", "a mount that gives way"),
    ("bias", "gyro_temp"): ("thermal gradients in the coil (Shupe)", "polarisation errors of the coupler"),
    ("bias", "gyro_temp_rate"): ("thermal gradients in the coil (Shupe)", "an asymmetric winding"),
    ("bias", "time"): ("a supply or reference that steps", "a device nearby that is switched", "warming up"),
    ("bias", "angle"): ("a magnetic field", "a tilted axis", "cables that pull"),
    ("bias", "rate"): ("a nonlinear converter or modulator", "cross-talk of the table's drive"),
    ("bias", "abs_rate"): ("cross-talk of the table's drive", "vibration that grows with the rate"),
    ("bias", "rate_sign"): ("backlash or slip between encoder and gyro", "cross-talk of the table's drive"),
    ("bias", "acceleration"): ("a delay between gyro and encoder", "a mount that gives way", "cross-coupling"),
    ("bias", "output"): ("a nonlinear converter or amplifier", "clipping"),
    ("torque", "time"): ("a brake that drags", "an amplifier or a supply that steps", "a bearing that warms up"),
    ("torque", "angle"): ("a rough place of a bearing", "a cable that pulls", "a load out of balance"),
    ("torque", "rate"): ("a lubricant that changes its regime", "a resonance of table or belt", "air drag"),
    ("torque", "abs_rate"): ("a resonance of table or belt", "an amplifier at its limit"),
    ("torque", "rate_sign"): ("a gear or belt that resists more one way",),
    ("torque", "acceleration"): ("play or twist between motor and encoder", "an amplifier at its limit"),
    ("heat", "time"): ("a device or a lamp that is switched", "a compressor or a vent that opens", "a door"),
    ("heat", "chamber_temp"): ("water that freezes, melts or evaporates", "a vent or a damper that opens by itself"),
    ("loss", "time"): ("a door or a lid that was opened and closed", "a fan that ran for a while"),
    ("heat", "heater"): ("a heater that does not switch on at once", "a fuse or a phase that is missing"),
}
_MOST_OF_IT = 0.8
"""Minimum share of the residual power that a model must explain."""
_CLEARLY_LESS = 0.5
"""Smooth curves replace simple shapes with a significant residual if they reduce its power by this factor."""
_OF_STAGE: Mapping[str, tuple[str, ...]] = {
    "encoder": ("a slipping coupling", "lost counts", "a new index of the encoder"),
    "noise": ("a connection that is about to fail", "a source that loses light", "interference"),
    "sampling": ("a clock that drifts", "a filter whose delay changes", "processing whose time depends on load"),
}
_UNSEEN = "Rests behind motion that was not recorded are left out: which way the table turned last is not known there."
_RAMPS = "Samples within 8 s of the start or end of a ramp are left out: the chamber's ramp is known only from its air."
_RAMP_ENDS_S = 8.0
_BY_WAY = ("friction in a winding, a glue or a mount", "a magnetic shield that keeps its state")
_BY_SETPOINT = ("the chamber's compressor or heater, which runs while the set point moves", "a supply that it loads")
_AT_INSTANTS = ("a device that is switched", "a slipping coupling", "a knock")
_PERIODIC = ("a controller that cycles", "a compressor", "interference")


def evident_structure(problem: GyroProblem, bare: Selection, *, seed: int) -> Modelled | None:
    """Return a single simple structure that explains all that a selection without effects leaves; None if none does.

    Named effects together could follow it in part, and the search for such a combination takes several times as long as
    all else. If the noise is not white in addition to the structure, it is not evident.
    """
    rest = residual_structure_of(problem, bare.whitener, bare.after, seed=seed)
    found = modelled(problem, bare, rest, most=1, seed=seed) if rest.significant else None
    if found is None or found.left.significant:
        return None
    noisy = found.chosen.noise.best(problem, found.chosen.after, least_gain=bare.least)
    return found if noisy is None else None


def with_structures(
    problem: PartProblem,
    chosen: Selection,
    unexplained: Unexplained,
    notes: tuple[str, ...],
    *,
    searched: Selection,
    spikes: bool = False,
    evident: Modelled | None = None,
    seed: int,
) -> tuple[Selection, Unexplained, tuple[str, ...]]:
    """Return the selection with the residual modelled, and the report on it; unchanged if no shape fits.

    Named effects of the selection that was `searched`, dropped because of a residual, are tried again with the
    structures. If the output has `spikes`, jumps of the encoder's angle are not searched.

    A small residual attributed to an inexact finding (`notes`) is still a structure if a shape explains it over a
    coordinate along which no finding acts. Jumps of the encoder and noise that is not constant may not be visible in
    the residual, so they are always searched. An `evident` structure of the selection is not searched again, and all
    named effects are tried with it.
    """
    if isinstance(problem, DriveProblem):
        return _of_torque(problem, chosen, unexplained, notes, searched, seed)
    if isinstance(problem, ChamberProblem):
        return _of_heat(problem, chosen, unexplained, notes, seed)
    if not isinstance(problem, GyroProblem):
        return chosen, unexplained, notes
    fallen = searched.identifiers - chosen.identifiers
    chosen, stated, notes = _of_prediction(problem, chosen, unexplained, notes, fallen, spikes, evident, seed)
    noisy = noise_structure(problem, chosen)
    if noisy is None:
        return chosen, stated, notes
    return with_noise(problem, chosen, noisy), _of_noise(noisy, stated), notes


def _of_prediction(
    problem: GyroProblem,
    chosen: Selection,
    unexplained: Unexplained,
    notes: tuple[str, ...],
    fallen: Collection[str],
    spikes: bool,
    evident: Modelled | None,
    seed: int,
) -> tuple[Selection, Unexplained, tuple[str, ...]]:
    """Do the same for structures that change the prediction."""
    bare = chosen
    # an unrecognised spike of one row looks like a jump of the angle
    chosen, jumps = (chosen, ()) if spikes or evident else with_jumps(problem, chosen)
    found = (chosen, evident) if evident else _modelled(problem, chosen, unexplained, notes, seed)
    known = _where_direction_is_known(problem, chosen, unexplained, found, seed)
    found = found if known is None else known
    between = _between_ramps(problem, found, seed)
    found = found if between is None else between
    if found is None and not jumps:
        return chosen, unexplained, notes
    if found is None:
        rest = residual_structure_of(problem, chosen.whitener, chosen.after, seed=seed)
        by_shapes = Modelled(chosen=chosen, structures=(), ties=(), left=rest)
    else:
        bare, by_shapes, notes = (found[0] if not jumps else bare), found[1], ()
    if known is not None:
        notes = (_UNSEEN,)
    if between is not None:
        notes = (*notes, _RAMPS)
    instead = chosen.noise.found.keys() - by_shapes.chosen.noise.found.keys()  # a replaced process
    by_shapes = as_one_curve(problem, by_shapes, seed)
    if not (jumps or spikes):  # with the structures in the model, jumps may become significant
        extended, jumps = with_jumps(problem, by_shapes.chosen)
        by_shapes = replace(by_shapes, chosen=extended)
    if len(by_shapes.structures) > 1:
        by_shapes = _named_beside_first(problem, by_shapes, seed)
    if instead or evident or by_shapes.left.significant:
        by_shapes = _named_again(problem, by_shapes, seed)
    elif fallen:
        by_shapes = _named_again(_knowing(problem, fallen, by_shapes.chosen), by_shapes, seed)
    by_shapes = replace(
        by_shapes, chosen=settled(problem, by_shapes.chosen), structures=(*jumps, *by_shapes.structures)
    )
    share = unexplained.share if unexplained.significant else _share(bare, by_shapes)
    rest = residual_structure_of(problem, bare.whitener, bare.after, seed=seed)
    return by_shapes.chosen, _stated(problem, by_shapes, rest, share), notes


def _of_torque(
    problem: DriveProblem,
    chosen: Selection,
    unexplained: Unexplained,
    notes: tuple[str, ...],
    searched: Selection,
    seed: int,
) -> tuple[Selection, Unexplained, tuple[str, ...]]:
    """Do the same for a drive's torque. Friction can follow many structures, so named effects are searched again."""
    found = torque_modelled(problem, chosen, searched, left=unexplained.significant, seed=seed)
    if found.chosen is chosen:
        return chosen, unexplained, notes
    found = as_one_curve(problem, found, seed)
    found = replace(found, chosen=settled(problem, found.chosen))
    if not found.structures:  # the effects found with a structure suffice without it
        return found.chosen, _left_of(found, unexplained), notes
    bare = reduced(problem, found.chosen, structures_of(found.chosen))
    rest = residual_structure_of(problem, bare.whitener, bare.after, seed=seed)
    if _explained(rest, found.left) < _MOST_OF_IT:
        restated = _restated(problem, chosen, bare, rest, seed)
        if restated is None:
            return chosen, unexplained, notes
        return restated.chosen, _left_of(restated, unexplained), ()
    return found.chosen, _stated(problem, found, rest, _share(bare, found)), ()


def _restated(
    problem: DriveProblem, chosen: Selection, bare: Selection, rest: ResidualStructure, seed: int
) -> Modelled | None:
    """Return the selection `bare` if its new names explain more than remains; None if no name is new.

    `bare` holds names that a residual withdrew from `chosen`; names that explain less than remains are left out again.
    """
    while not bare.evidence.keys() <= chosen.evidence.keys():
        gains = {key: gain_of(bare.after, reduced(problem, bare, {key}).after) for key in bare.evidence}
        weak = {key for key, gain in gains.items() if key not in chosen.evidence and gain < rest.gain}
        if not weak or not rest.significant:
            return Modelled(chosen=bare, structures=(), ties=(), left=rest)
        bare = reduced(problem, bare, weak)
        rest = residual_structure_of(problem, bare.whitener, bare.after, seed=seed)
    return None


def _of_heat(
    problem: ChamberProblem, chosen: Selection, unexplained: Unexplained, notes: tuple[str, ...], seed: int
) -> tuple[Selection, Unexplained, tuple[str, ...]]:
    """Do the same for a chamber's heat, which several named effects may imitate."""
    found = heat_modelled(problem, chosen, left=unexplained.significant, seed=seed)
    if found is None or found.chosen.named is None:
        missed = problem.much_missed(chosen.after.residual)
        if missed and not unexplained.significant:
            share = float(np.sum(chosen.after.residual**2) / np.sum(chosen.before.residual**2))
            unexplained = Unexplained(significant=True, share=min(share, 1.0), coordinates=("time",), says=missed)
        return chosen, unexplained, notes
    rest = disturbed_residual(problem, found.chosen.named)
    return found.chosen, _stated(problem, found, rest, _share(chosen, found)), notes


def _left_of(found: Modelled, unexplained: Unexplained) -> Unexplained:
    """Return what the named effects alone leave unexplained."""
    if not found.left.significant:
        return NOTHING
    return replace(unexplained, coordinates=found.left.coordinates, says=found.left.says)


def _modelled(
    problem: GyroProblem, chosen: Selection, unexplained: Unexplained, notes: tuple[str, ...], seed: int
) -> tuple[Selection, Modelled] | None:
    """Return the selection before structures were added, and the model with them; None if there are none."""
    better = instead_of_names(problem, chosen, left=bool(unexplained.significant or notes), seed=seed)
    if better is not None:
        return better
    if not (unexplained.significant or notes):
        return None
    rest = residual_structure_of(problem, chosen.whitener, chosen.after, seed=seed)
    findings = () if unexplained.significant else chosen.after.point.effects
    named = tuple(one for one in findings if not isinstance(one, Structure))
    best: Modelled | None = None
    scan = Scan(problem, chosen)
    for smooth in (False, True):
        found = modelled(problem, chosen, rest, apart_from=named, smooth=smooth, scan=scan, seed=seed)
        if found is None:
            continue
        if not found.left.significant or is_attributable(found.left, gain_of(found.chosen.after, chosen.after)):
            return chosen, found
        if best is None or found.left.power < _CLEARLY_LESS * best.left.power:
            best = found
    return None if best is None or _explained(rest, best.left) < _MOST_OF_IT else (chosen, best)


def _where_direction_is_known(
    problem: GyroProblem,
    chosen: Selection,
    unexplained: Unexplained,
    found: tuple[Selection, Modelled] | None,
    seed: int,
) -> tuple[Selection, Modelled] | None:
    """Do the same on rows with a known last direction of the table, if this direction is the largest part of it."""
    alone = found is not None and len(found[1].structures) == 1 and not found[1].left.significant
    if alone or not {"rate_sign", "step"} & {*unexplained.coordinates}:
        return None
    rows = turned_unseen(problem.frame)
    rows = rows if problem.band is None else rows[problem.band.rows]
    if not rows.any():
        return None
    known, extended = _modelled_without(problem, chosen, rows, seed=seed)
    if extended is not None and _of_last_direction(extended):
        return known, extended
    instead = instead_of_names(problem, known, left=True, seed=seed)
    return instead if instead is not None and _of_last_direction(instead[1]) else None


def _between_ramps(
    problem: GyroProblem, found: tuple[Selection, Modelled] | None, seed: int
) -> tuple[Selection, Modelled] | None:
    """Do the same without the rows near the ends of ramps, if a structure depends on the set point.

    The ramps of the set point are known only from the air temperature. Return None if no structure depends on the set
    point, or if another coordinate then explains the residual.
    """
    if found is None or all(one.over != "setpoint" for one in found[1].structures):
        return None
    time_s, way = problem.time_s, problem.coordinates["setpoint"]
    ends_s = time_s[1:][np.diff(way) != 0.0]
    nearest = np.clip(np.searchsorted(ends_s, time_s), 1, ends_s.size - 1)
    rows = np.minimum(np.abs(time_s - ends_s[nearest - 1]), np.abs(time_s - ends_s[nearest])) < _RAMP_ENDS_S
    known, again = _modelled_without(problem, found[0], rows, seed=seed)
    if again is None or again.structures[0].over != "setpoint" or len(again.structures) > len(found[1].structures):
        return None
    return known, again


def _modelled_without(
    problem: GyroProblem, chosen: Selection, rows: BoolArray, *, seed: int
) -> tuple[Selection, Modelled | None]:
    """Return the selection refitted without some rows, shape (n,), and the model of its residual."""
    known = leaving_out(problem, chosen, rows)
    rest = residual_structure_of(problem, known.whitener, known.after, seed=seed)
    return known, modelled(problem, known, rest, seed=seed)


def _of_last_direction(found: Modelled) -> bool:
    """Return whether the last direction of rotation explains most of the residual, and others the complete rest."""
    return not found.left.significant and found.structures[0].over == "last_sign"


def _knowing(problem: GyroProblem, names: Collection[str], chosen: Selection) -> GyroProblem:
    """Return the problem restricted to some named effects and those of the selection."""
    known = {*names, *chosen.noise.found, *chosen.identifiers}
    return replace(problem, without=problem.without | (effects().keys() - known))


def _named_again(problem: GyroProblem, found: Modelled, seed: int) -> Modelled:
    """Return the model with named effects that replace or extend its structures, if these are as good.

    In a swing at a single frequency, all coordinates of the motion are equivalent, so nothing is changed.
    """
    if swinging_hz(problem):
        return found
    structures = [one for one in found.chosen.after.point.effects if isinstance(one, Structure)]
    kinds = {one.identifier for one in structures}
    if not structures or len(kinds) < len(structures):  # a search does not know two of a kind apart
        return found
    again = select(problem, seed=seed, progress=lambda _name, _share: None, chosen=found.chosen)
    kept = tuple(one for one in found.structures if one.identifier in again.identifiers)
    if not kept or again.noise.found.keys() != found.chosen.noise.found.keys():
        return found
    needless = CLEARLY if len(kept) == len(found.structures) else 0.0  # an added effect must be significant
    if _lost(again, found) > -needless:
        return found
    left = residual_structure_of(problem, again.whitener, again.after, seed=seed)
    return Modelled(chosen=again, structures=kept, ties=found.ties, left=left)


def _lost(again: Selection, found: Modelled) -> float:
    """Return the gain that a model loses against another one, with the price of the parameters that it has more."""
    one, other = again.after, found.chosen.after
    more = len(one.numbers) - len(other.numbers)
    return other.rows * math.log(one.squares / other.squares) + more * math.log(one.rows)


def _named_beside_first(problem: GyroProblem, found: Modelled, seed: int) -> Modelled:
    """Return the model with named effects in place of all structures but the first, if these explain at least as much.

    A strong structure hides weak effects from the search for named effects, and further structures then follow them.
    Names along a coordinate of the kind of the first structure are excluded: they follow the errors of its shape.
    """
    first, keys = found.structures[0], structures_of(found.chosen)
    others = {key for key, its in keys.items() if its != first.identifier}
    if swinging_hz(problem) or len(others) < len(keys) - 1:  # a search does not know two of a kind apart
        return found
    less = reduced(problem, found.chosen, others)
    again = select(problem, seed=seed, progress=lambda _name, _share: None, chosen=less)
    names = [one.coordinate for one in again.after.point.effects if one.identifier not in found.chosen.identifiers]
    if (
        not structures_of(again)
        or _lost(again, found) > 0.0
        or any(kind_of(word) == kind_of(first.over) for one in names for word in one.split("*"))
    ):
        return found
    left = residual_structure_of(problem, again.whitener, again.after, seed=seed)
    if left.significant and not (found.left.significant and left.power <= found.left.power):
        return found
    return Modelled(chosen=again, structures=found.structures[:1], ties=found.ties, left=left)


def _share(chosen: Selection, found: Modelled) -> float:
    """Return the share of the initial residual power that the structures explain."""
    first, bare, after = chosen.before.squares, chosen.after.squares, found.chosen.after.squares
    return min(max((bare - after) / max(first - after, 1e-300), 0.0), 1.0)


def _stated(
    problem: Structurable | ChamberProblem, found: Modelled, rest: ResidualStructure, share: float
) -> Unexplained:
    models = tuple(_models(problem, found.chosen, found.structures, _explained(rest, found.left)))
    coordinates = (found.structures[0].word, *found.ties)
    sentence = " ".join(one.says for one in models)
    if found.ties:
        others = " or ".join(PHRASES.get(word, word) for word in found.ties)
        sentence += f" This recording does not separate it from a dependence on {others}."
    sentence += " No known effect accounts for it."
    if found.left.significant:
        sentence += f" A residual remains in addition. {found.left.says}"
    return Unexplained(significant=True, share=share, coordinates=coordinates, says=sentence, models=models)


def _of_noise(noisy: NoiseFound, unexplained: Unexplained) -> Unexplained:
    """Return the report with a structure of the noise as its last model."""
    effect = noisy.structure
    model = StructureModel(
        identifier=effect.identifier,
        stage=effect.acts_on,
        coordinates=(effect.word,),
        shape=effect.shape,
        formula=_formula(effect),
        parameters=noisy.estimates,
        explains=noisy.explains,
        says=effect.says(),
        hints=_hints(effect),
    )
    if not unexplained.significant:
        return Unexplained(
            significant=True,
            share=noisy.explains,
            coordinates=model.coordinates,
            says=f"{effect.says()} No known effect accounts for it.",
            models=(model,),
        )
    sentence = f"{unexplained.says} {effect.says()}"
    return replace(unexplained, says=sentence, models=(*unexplained.models, model) if unexplained.models else ())


def _explained(before: ResidualStructure, after: ResidualStructure) -> float:
    if not after.significant:
        return 1.0
    return min(max(1.0 - after.power / max(before.power, 1e-300), 0.0), 1.0)


def _models(
    problem: Structurable | ChamberProblem, chosen: Selection, structures: Sequence[Structure], explains: float
) -> Iterator[StructureModel]:
    """Yield the models of the structures of a selection, in the order in which they were found."""
    kinds = list(dict.fromkeys(one.identifier for one in structures))
    models = [
        (kinds.index(effect.identifier), key, effect, parameters)
        for key, effect, parameters in estimates_of(problem, chosen)
        if isinstance(effect, Structure) and effect.identifier in kinds
    ]
    for _, key, effect, parameters in sorted(models, key=lambda one: one[0]):
        yield StructureModel(
            identifier=key,
            stage=effect.acts_on,
            coordinates=(effect.word,),
            shape=effect.shape,
            formula=_formula(effect),
            parameters=_with_edges(effect, parameters),
            explains=explains,
            says=effect.says(),
            hints=_hints(effect),
            curve=None if isinstance(problem, ChamberProblem) else curve_of(problem, chosen, key),
        )


def _with_edges(effect: Structure, parameters: Mapping[str, Estimate]) -> Mapping[str, Estimate]:
    """Return estimates with places uncertain by at least half the width of the change, and exact range ends."""
    half = 0.5 * effect.values["width"] if effect.is_stepped else 0.0
    ends = {name: effect.values[name] for name, one in effect.parameters.items() if one.role == "assumed"}
    parameters = {**parameters, **{name: replace(parameters[name], low=end, high=end) for name, end in ends.items()}}
    return {
        name: replace(one, low=one.low - half, high=one.high + half) if name in ("at", "at_2") else one
        for name, one in parameters.items()
    }


def _formula(effect: Structure) -> str:
    return ACTS[effect.acts_on].formula.format(f=SHAPES[effect.shape].written(effect.over, effect.times))


def _hints(effect: Structure) -> tuple[str, ...]:
    if effect.acts_on in _OF_STAGE:
        return _OF_STAGE[effect.acts_on]
    if effect.over == "setpoint":
        return _BY_SETPOINT
    if effect.shape == "hysteresis":
        return _BY_WAY
    known = _HINTS.get((effect.acts_on, effect.word), ())
    if effect.over == "time" and effect.shape in ("step", "plateau"):
        return (*_AT_INSTANTS, *known)
    return (*_PERIODIC, *known) if effect.over == "time" and effect.shape in ("wave", "bursts") else known


_BINS, _POINTS = 60, 400
_NUDGE = 1e-4
_FEWEST = 10


def curve_of(problem: Structurable, chosen: Selection, key: str) -> Curve | None:
    """Return the curve of a structure for a plot; None if it has a memory or its coordinate does not vary."""
    after = chosen.after
    place = keys_of(after.point.effects).index(key)
    effect = after.point.effects[place]
    coordinates, factors = coordinates_of(problem, after), factors_of(problem, after)
    if not isinstance(effect, Structure) or not effect.pointwise:
        return None
    if effect.acts_on not in factors or effect.over not in coordinates:
        return None
    x, factor = coordinates[effect.over], factors[effect.acts_on]
    if effect.times:
        factor = factor * coordinates[effect.times]
    rows = chosen.whitener.weight > 0.0
    rows &= chosen.heldout[problem.step] if chosen.heldout.any() else True
    x, factor, residual = x[rows], factor[rows], after.residual[rows]
    if not x.size or not np.ptp(x) > 0.0:
        return None
    span = float(x.min()), float(x.max())
    bins = bin_of(x, np.linspace(*span, _BINS + 1))

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(bins, values, minlength=_BINS), dtype=np.float64)

    power, count = summed(factor**2), np.bincount(bins, minlength=_BINS)
    filled = (count >= _FEWEST) & (power > 1e-6 * float(power.max()))
    power = power[filled]
    left = summed(factor * residual)[filled] / power
    along = np.linspace(*span, _POINTS)
    fitted, error = effect.value_at(along), _error(problem, chosen, place, effect, along)
    return Curve(
        place=summed(x)[filled] / count[filled],
        required=left + summed(factor**2 * effect.value_at(x))[filled] / power,
        left=left,
        error=chosen.white_deviation / np.sqrt(power),
        along=along,
        fitted=fitted,
        low=fitted - Z95 * error,
        high=fitted + Z95 * error,
    )


def _error(problem: Structurable, chosen: Selection, place: int, effect: Structure, along: FloatArray) -> FloatArray:
    """Return the standard error of the function at places (k,), from the covariance of the structure's parameters."""
    after = chosen.after
    mine = [i for i, one in enumerate(after.numbers) if one.effect == place]
    if not mine:
        return np.zeros_like(along)
    covariance = after.robust_covariance(problem.step)[np.ix_(mine, mine)]
    columns = []
    for number in (after.numbers[i] for i in mine):
        parameter, value = effect.parameters[number.name], effect.values[number.name]
        nudge = _NUDGE * (abs(value) or 1.0)
        moved = type(effect).make({**effect.values, number.name: value + nudge})
        slope = (moved.value_at(along) - effect.value_at(along)) / nudge
        columns.append(slope * value if parameter.logarithmic else slope)
    slopes = np.stack(columns)
    return np.asarray(np.sqrt(np.maximum(np.einsum("ak,ab,bk->k", slopes, covariance, slopes), 0.0)))
