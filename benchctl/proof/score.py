"""How right an answer is, once the truth is unsealed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from benchctl.diagnosis.keys import keys_of_names
from benchctl.proof.classes import CLASSES
from benchctl.proof.structures import SHAPE_CLASSES
from benchctl.proof.truth import Sealed
from benchctl_instruments.physics.effects.effect import Parameter
from benchctl_instruments.physics.structures import structure_named

_BY_CHANCE = {("dropouts", "count")}
"""What is drawn as an expectation: how many came in a recording is chance, and that is what is stated."""
_HARDLY_ANY = 1.02
"""A held-out residual of less than so many times the noise leaves no excess to speak of."""
PHASE_DEG = 10.0
"""How near a phase must come to count as within a tenth; a quarter is two and a half times that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterScore:
    """A parameter of an effect that was rightly named.

    `error` is relative to the truth; of a phase it is in units of a hundred degrees, so that 0.1 is `PHASE_DEG`; of a
    whole number it is 0 or infinite.
    """

    name: str
    truth: float
    value: float
    error: float
    inside_ci95: bool

    def within(self, share: float) -> bool:
        """Whether the value is that near the truth."""
        return self.error <= share


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """How right an answer is.

    Attributes
    ----------
    right
        Whether it is what its class asks for: exactly the drawn effects and nothing else; of an outsider, unknown
        structure in the right coordinate and no name; of a structure, a model at its stage over its coordinate alone.
    missed, made_up
        Effects that were drawn and not named, and named without having been drawn.
    verdict_right
        Whether the verdict is that of the class; None where the answer has none.
    located
        Of an outsider: whether the coordinate that is named first is one where it lives.
    shape_right
        Of a structure: whether it was modelled in its shape, or in the nearest that a search has.
    parameters
        Those of effects that were rightly named.
    heldout_ratio
        Held-out residual over the noise that was found.
    removed
        Share of the excess of the held-out residual over the noise, in power, that the model takes away; None where
        there is hardly any.
    """

    right: bool
    missed: tuple[str, ...]
    made_up: tuple[str, ...]
    verdict_right: bool | None = None
    located: bool | None = None
    shape_right: bool | None = None
    parameters: tuple[ParameterScore, ...] = ()
    heldout_ratio: float | None = None
    removed: float | None = None


def score_diagnosis(truth: Sealed, said: Mapping[str, Any]) -> Score:
    """Score a diagnosis, given as its JSON."""
    # a second effect of one kind, which no trial conceals, is one more
    found = dict(zip(keys_of_names(one["effect"] for one in said["findings"]), said["findings"], strict=True))
    missed, made_up = _differences(truth, found)
    verdict_right = said["verdict"] == truth.verdict
    located = _located(truth, said["unexplained"]) if truth.withheld else None
    structure = CLASSES[truth.kind].structure
    if structure and located:
        located = _modelled(truth, said["unexplained"])
    right = not missed and not made_up
    fit = said["fit"]
    return Score(
        right=right and (verdict_right or structure) and bool(located) if truth.withheld else right,
        missed=missed,
        made_up=made_up,
        verdict_right=verdict_right,
        located=located,
        shape_right=_shape_right(truth, said["unexplained"]),
        parameters=tuple(
            score
            for name in truth.effects
            if name in found
            for score in _parameters(name, truth, found[name]["parameters"])
        )
        + tuple(_of_structures(truth, said["unexplained"])),
        heldout_ratio=fit["heldout_after"] / fit["noise"] if fit["noise"] and fit["heldout_after"] else None,
        removed=_removed(fit),
    )


def score_regression(truth: Sealed, said: Mapping[str, Any]) -> Score:
    """Score the sparse regression; it has no word for unknown structure, so that with an outsider it is never right."""
    missed, made_up = _differences(truth, dict.fromkeys(said["effects"]))
    return Score(
        right=not missed and not made_up and not truth.withheld,
        missed=missed,
        made_up=made_up,
        located=False if truth.withheld else None,
        heldout_ratio=said["heldout_ratio"],
    )


def _removed(fit: Mapping[str, Any]) -> float | None:
    noise, before, after = (fit.get(name) for name in ("noise", "heldout_before", "heldout_after"))
    if not (noise and before and after) or before < _HARDLY_ANY * noise:
        return None
    return float(1.0 - (after**2 - noise**2) / (before**2 - noise**2))


def _differences(truth: Sealed, found: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return tuple(sorted(truth.nameable - found.keys())), tuple(sorted(found.keys() - truth.effects.keys()))


def _located(truth: Sealed, unexplained: Mapping[str, Any]) -> bool:
    named = unexplained["coordinates"]
    return bool(unexplained["significant"] and named and not set(named[0].split("*")).isdisjoint(truth.lives_in))


def models_in(unexplained: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The models of what is unexplained."""
    return [unexplained["model"], *unexplained.get("further", ())] if "model" in unexplained else []


def _modelled(truth: Sealed, unexplained: Mapping[str, Any]) -> bool:
    """Whether what is unexplained is modelled at the stage and over the coordinate of the concealed structure alone."""
    said = {(one["stage"], frozenset(one["coordinates"][0].split("*"))) for one in models_in(unexplained)}
    drawn = [found for name in truth.withheld if (found := structure_named(name)) is not None]
    true = {(one.acts_on, frozenset(one.word.split("*"))) for one in drawn}
    return said == true and len(unexplained["coordinates"]) == 1


def _shape_right(truth: Sealed, unexplained: Mapping[str, Any]) -> bool | None:
    """Whether what is unexplained is modelled in the shapes that were drawn, or in those nearest to them."""
    drawn = {found.shape for name in truth.withheld if (found := structure_named(name)) is not None}
    if not drawn:
        return None
    said = {one["shape"] for one in models_in(unexplained)}
    return {SHAPE_CLASSES.get(one, one) for one in said} == {SHAPE_CLASSES.get(one, one) for one in drawn}


def _of_structures(truth: Sealed, unexplained: Mapping[str, Any]) -> Iterator[ParameterScore]:
    for model in models_in(unexplained):
        if model["name"] in truth.effects and model["coordinates"] != ["time"]:  # whose origin no plan knows
            yield from _parameters(model["name"], truth, model["parameters"])


def _parameters(identifier: str, truth: Sealed, stated: Mapping[str, Mapping[str, Any]]) -> list[ParameterScore]:
    described, drawn = truth.kind_of(identifier).parameters, truth.effects[identifier]
    scores = []
    for name, value in drawn.items():
        if name not in stated or stated[name]["value"] is None or (identifier, name) in _BY_CHANCE:
            continue
        estimate, (low, high) = stated[name]["value"], stated[name]["ci95"]
        period = 360.0 / drawn.get("order", 1.0) if described[name].role == "phase" else None
        scores.append(
            ParameterScore(
                name=f"{identifier}.{name}",
                truth=value,
                value=estimate,
                error=_error(described[name], value, estimate, period),
                inside_ci95=_inside(value, low, high, period),
            )
        )
    return scores


def _error(parameter: Parameter, truth: float, value: float, period_deg: float | None) -> float:
    if period_deg is not None:
        return abs(math.remainder(value - truth, period_deg)) / (10.0 * PHASE_DEG)
    if parameter.role == "choice":
        return 0.0 if round(value) == round(truth) else math.inf
    return abs(value - truth) / abs(truth)


def _inside(truth: float, low: float | None, high: float | None, period_deg: float | None) -> bool:
    if low is None or high is None:
        return False
    if period_deg is None:
        return low <= truth <= high
    middle = 0.5 * (low + high)
    return abs(math.remainder(truth - middle, period_deg)) <= 0.5 * (high - low)
