"""Score an answer after the truth is unsealed."""

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
"""Parameters drawn as an expectation: the number in a recording is random, and it is that number that is stated."""
_HARDLY_ANY = 1.02
"""Below this ratio of the held-out residual to the noise there is no notable excess."""
PHASE_DEG = 10.0
"""Error of a phase that counts as within a tenth; a quarter is two and a half times that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterScore:
    """A parameter of an effect that was correctly named.

    `error` is relative to the truth; for a phase it is in units of a hundred degrees, so that 0.1 is `PHASE_DEG`; for
    an integer it is 0 or infinite.
    """

    name: str
    truth: float
    value: float
    error: float
    inside_ci95: bool

    def within(self, share: float) -> bool:
        """Return whether the relative error is at most `share`."""
        return self.error <= share


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """How right an answer is.

    Attributes
    ----------
    right
        Whether it meets the requirement of its class: exactly the drawn effects and nothing else; for an outsider,
        unknown structure in the right coordinate and no name; for a structure, a model at its stage over its coordinate
        alone.
    missed, made_up
        Effects that were drawn and not named, and effects that were named and not drawn.
    verdict_right
        Whether the verdict is that of the class; None if the answer has none.
    located
        For an outsider: whether the first named coordinate is one in which it appears.
    shape_right
        For a structure: whether it was modelled in its shape, or in the nearest shape of the search.
    parameters
        Parameters of effects that were correctly named.
    heldout_ratio
        Held-out residual over the estimated noise.
    removed
        Share of the excess power of the held-out residual over the noise that the model removes; None if there is
        hardly any excess.
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


def score_diagnosis(truth: Sealed, answer: Mapping[str, Any]) -> Score:
    """Score a diagnosis, given as JSON data."""
    # a second effect of the same kind, which no trial conceals, counts as an additional one
    found = dict(zip(keys_of_names(one["effect"] for one in answer["findings"]), answer["findings"], strict=True))
    missed, made_up = _differences(truth, found)
    verdict_right = answer["verdict"] == truth.verdict
    located = _located(truth, answer["unexplained"]) if truth.withheld else None
    structure = CLASSES[truth.kind].structure
    if structure and located:
        located = _modelled(truth, answer["unexplained"])
    right = not missed and not made_up
    fit = answer["fit"]
    return Score(
        right=right and (verdict_right or structure) and bool(located) if truth.withheld else right,
        missed=missed,
        made_up=made_up,
        verdict_right=verdict_right,
        located=located,
        shape_right=_shape_right(truth, answer["unexplained"]),
        parameters=tuple(
            score
            for name in truth.effects
            if name in found
            for score in _parameters(name, truth, found[name]["parameters"])
        )
        + tuple(_of_structures(truth, answer["unexplained"])),
        heldout_ratio=fit["heldout_after"] / fit["noise"] if fit["noise"] and fit["heldout_after"] else None,
        removed=_removed(fit),
    )


def score_regression(truth: Sealed, answer: Mapping[str, Any]) -> Score:
    """Score the sparse regression; it cannot state unknown structure, so it is never right for an outsider."""
    missed, made_up = _differences(truth, dict.fromkeys(answer["effects"]))
    return Score(
        right=not missed and not made_up and not truth.withheld,
        missed=missed,
        made_up=made_up,
        located=False if truth.withheld else None,
        heldout_ratio=answer["heldout_ratio"],
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
    """Return the models of the unexplained structure."""
    return [unexplained["model"], *unexplained.get("further", ())] if "model" in unexplained else []


def _modelled(truth: Sealed, unexplained: Mapping[str, Any]) -> bool:
    """Return whether the model has exactly the stage and the coordinate of the concealed structure."""
    modelled = {(one["stage"], frozenset(one["coordinates"][0].split("*"))) for one in models_in(unexplained)}
    drawn = [found for name in truth.withheld if (found := structure_named(name)) is not None]
    true = {(one.acts_on, frozenset(one.word.split("*"))) for one in drawn}
    return modelled == true and len(unexplained["coordinates"]) == 1


def _shape_right(truth: Sealed, unexplained: Mapping[str, Any]) -> bool | None:
    """Return whether the model has the shapes that were drawn, or the nearest shapes of the search."""
    drawn = {found.shape for name in truth.withheld if (found := structure_named(name)) is not None}
    if not drawn:
        return None
    modelled = {one["shape"] for one in models_in(unexplained)}
    return {SHAPE_CLASSES.get(one, one) for one in modelled} == {SHAPE_CLASSES.get(one, one) for one in drawn}


def _of_structures(truth: Sealed, unexplained: Mapping[str, Any]) -> Iterator[ParameterScore]:
    for model in models_in(unexplained):
        if model["name"] in truth.effects and model["coordinates"] != ["time"]:  # the plan does not fix the time origin
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
