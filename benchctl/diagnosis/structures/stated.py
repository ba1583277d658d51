"""Structures without a name as a diagnosis states them: sentence, formula, intervals, and kinds of causes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from benchctl.diagnosis.findings.findings import estimates_of
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.rest.rest import Rest, rest_of
from benchctl.diagnosis.result import StructureModel, Unexplained
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.structures.search import Modelled, modelled
from benchctl.diagnosis.structures.settled import instead_of_names, settled
from benchctl_instruments.physics.structures import FORMULAS, PHRASES, Structure

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
}
_MOST_OF_IT = 0.8
"""A model that explains less of what is left, in power, is none."""
_AT_INSTANTS = ("a device that is switched", "a slipping coupling", "a knock")
_PERIODIC = ("a controller that cycles", "a compressor", "interference")


def with_structures(
    problem: Problem, chosen: Selection, unexplained: Unexplained, owed: tuple[str, ...], *, seed: int
) -> tuple[Selection, Unexplained, tuple[str, ...]]:
    """The selection with what is unexplained modelled, and what is then said of it; as it is where no shapes fit.

    What is little enough to be `owed` to the model of a finding is a structure all the same where a shape explains it
    over another coordinate than those along which findings act.
    """
    if not isinstance(problem, GyroProblem):
        return chosen, unexplained, owed
    if (better := instead_of_names(problem, chosen, seed=seed)) is not None:
        less, instead = better
        return *_taken(problem, less, instead, _share(less, instead), seed), ()
    if not (unexplained.significant or owed):
        return chosen, unexplained, owed
    rest = rest_of(problem, chosen.whitener, chosen.after, seed=seed)
    findings = () if unexplained.significant else chosen.after.point.effects
    found = modelled(problem, chosen, rest, apart_from=findings, seed=seed)
    if found is None or _explained(rest, found.left) < _MOST_OF_IT:
        return chosen, unexplained, owed
    share = unexplained.share if unexplained.significant else _share(chosen, found)
    return *_taken(problem, chosen, found, share, seed), ()


def _taken(
    problem: GyroProblem, bare: Selection, found: Modelled, share: float, seed: int
) -> tuple[Selection, Unexplained]:
    """The selection with what was modelled beside a `bare` one, and what is said of it."""
    found = replace(found, chosen=settled(problem, found.chosen))
    rest = rest_of(problem, bare.whitener, bare.after, seed=seed)
    return found.chosen, _stated(problem, found, rest, share)


def _share(chosen: Selection, found: Modelled) -> float:
    """What the structures explain of what was left at first, in power."""
    first, bare, after = chosen.before.squares, chosen.after.squares, found.chosen.after.squares
    return min(max((bare - after) / max(first - after, 1e-300), 0.0), 1.0)


def _stated(problem: Problem, found: Modelled, rest: Rest, share: float) -> Unexplained:
    models = tuple(_models(problem, found.chosen, found.structures, _explained(rest, found.left)))
    coordinates = (found.structures[0].coordinate, *found.ties)
    says = " ".join(one.says for one in models)
    if found.ties:
        others = " or ".join(PHRASES.get(word.split("*")[0], word) for word in found.ties)
        says += f" This recording does not tell it from a dependence on {others}."
    says += " No known effect accounts for it."
    if found.left.significant:
        says += f" Beside it something is left. {found.left.says}"
    return Unexplained(significant=True, share=share, coordinates=coordinates, says=says, models=models)


def _explained(before: Rest, after: Rest) -> float:
    if not after.significant:
        return 1.0
    return min(max(1.0 - after.power / max(before.power, 1e-300), 0.0), 1.0)


def _models(
    problem: Problem, chosen: Selection, structures: Sequence[Structure], explains: float
) -> Iterator[StructureModel]:
    identifiers = {one.identifier for one in structures}
    for key, effect, parameters in estimates_of(problem, chosen):
        if not isinstance(effect, Structure) or effect.identifier not in identifiers:
            continue
        yield StructureModel(
            identifier=key,
            stage=effect.acts_on,
            coordinates=(effect.over,),
            shape=effect.shape,
            formula=_formula(effect),
            parameters=parameters,
            explains=explains,
            says=effect.says(),
            hints=_hints(effect),
        )


def _formula(effect: Structure) -> str:
    f = FORMULAS[effect.shape].format(x=effect.over)
    return f"K = K0·(1 + {f})" if effect.acts_on == "scale" else f"U = U0 + {f}"


def _hints(effect: Structure) -> tuple[str, ...]:
    known = _HINTS.get((effect.acts_on, effect.over), ())
    if effect.over == "time" and effect.shape in ("step", "plateau"):
        return (*_AT_INSTANTS, *known)
    return (*_PERIODIC, *known) if effect.over == "time" and effect.shape == "wave" else known
