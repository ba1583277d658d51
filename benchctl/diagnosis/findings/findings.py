"""The findings of a selection, with values, intervals, evidence and alternatives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from benchctl.diagnosis.findings.located import where_of
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.result import Alternative, Estimate, Finding
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import judged
from benchctl.estimation.noise import Noisy
from benchctl.estimation.noise_model import GROWING
from benchctl.estimation.point import FREE, interval_of
from benchctl.signals.normal import Z95
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.effects.registry import effect as effect_named
from benchctl_instruments.physics.structures import Structure

_NEAR = 0.001
"""Alternatives with a smaller probability are not listed."""


def findings_of(problem: PartProblem, chosen: Selection) -> tuple[Finding, ...]:
    """Return the findings of a selection: first the effects, then those about the noise."""
    return (*_effects(problem, chosen), *_noises(problem, chosen))


def noise_effects(chosen: Selection) -> tuple[DescribedEffect, ...]:
    """Return what was found about the noise, as effects with their sizes."""
    return tuple(_as_effect(one, chosen.white_deviation) for one in chosen.noise.found.values())


def _effects(problem: PartProblem, chosen: Selection) -> Iterator[Finding]:
    named = chosen.named or chosen.after
    total = chosen.before.squares - named.squares
    if problem.disturbed:
        total = float(np.sum(judged(problem, chosen.before) ** 2 - judged(problem, named) ** 2))
    total = max(total, 1e-300)
    for key, effect, estimates in estimates_of(problem, chosen):
        if isinstance(effect, Structure):
            continue
        evidence = chosen.evidence[key]
        alternatives, probability = _alternatives(evidence.rivals)
        yield Finding(
            effect=effect.identifier,
            probability=probability,
            parameters=estimates,
            where=where_of(problem, evidence.excess, effect.coordinate),
            explains=min(max(float(evidence.excess.sum()) / total, 0.0), 1.0),
            gain=evidence.gain,
            gain_heldout=evidence.heldout,
            says=effect.says(),
            alternatives=alternatives,
        )


def estimates_of(problem: PartProblem, chosen: Selection) -> Iterator[tuple[str, DescribedEffect, dict[str, Estimate]]]:
    """Yield every effect of the model with its key and its parameters with intervals."""
    fitted = chosen.full
    errors = fitted.standard_errors(problem.step)
    for place, (key, effect) in enumerate(zip(keys_of(fitted.point.effects), fitted.point.effects, strict=True)):
        estimates: dict[str, Estimate] = {}
        for name, parameter in effect.parameters.items():
            value = effect.values[name]
            index = next((i for i, one in enumerate(fitted.numbers) if one.effect == place and one.name == name), None)
            # a parameter that the recording does not determine, such as an unreached rail, has its full allowed range
            half = 0.0 if index is None else Z95 * float(errors[index])
            half = math.inf if parameter.role == "assumed" else half
            low, high = interval_of(parameter, value, half)
            if half and parameter.role != "phase":
                low, high = max(low, min(parameter.low, value)), min(high, max(parameter.high, value))
            estimates[name] = Estimate(value=value, low=low, high=high, unit=parameter.unit)
        yield key, effect, estimates


def _alternatives(rivals: Mapping[str, float]) -> tuple[tuple[Alternative, ...], float]:
    """Return the rivals with their probability, the likeliest first, and the probability of the finding."""
    odds = {
        name: math.exp(-min(max(loss, 0.0), 1400.0) / 2.0)
        for name, loss in sorted(rivals.items(), key=lambda one: one[1])
    }
    total = 1.0 + sum(odds.values())
    named = tuple(
        Alternative(effect=name, probability=chance / total, loss=rivals[name])
        for name, chance in odds.items()
        if chance / total > _NEAR
    )
    return named, 1.0 / total


def _noises(problem: PartProblem, chosen: Selection) -> Iterator[Finding]:
    excess = (chosen.before.white**2 - chosen.after.white**2).astype(np.float32)
    for one, effect in zip(chosen.noise.found.values(), noise_effects(chosen), strict=True):
        alternatives, probability = _alternatives(one.rivals)
        yield Finding(
            effect=one.effect,
            probability=probability / (1.0 + math.exp(-min(one.gain, 1400.0) / 2.0)),
            parameters=_interval(effect, one),
            where=where_of(problem, excess, effect.coordinate),
            explains=min(max(1.0 - chosen.after.squares / chosen.before.squares, 0.0), 1.0),
            gain=one.gain,
            gain_heldout=0.0,
            says=effect.says(),
            alternatives=alternatives,
        )


def _as_effect(one: Noisy, white: float) -> DescribedEffect:
    kind = effect_named(one.effect)
    name = next(iter(kind.parameters))
    value = math.sqrt(1.0 + one.size) if one.effect == GROWING else one.size * white
    return kind.make({name: value})


def _interval(effect: DescribedEffect, one: Noisy) -> Mapping[str, Estimate]:
    ((name, value),) = effect.values.items()
    # the growth of the variance is factor² − 1, so the relative error of the factor is smaller
    share = one.size / (2.0 * (1.0 + one.size)) if one.effect == GROWING else 1.0
    wide = math.exp(min(Z95 * one.log_error * share, FREE))
    unit = effect.parameters[name].unit
    return {name: Estimate(value=value, low=value / wide, high=value * wide, unit=unit)}
