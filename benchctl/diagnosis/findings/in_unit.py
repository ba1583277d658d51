"""What effects say in volts, in the unit of a gyro whose output has another: a digital one states its rate."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from benchctl.diagnosis.result import Estimate, Finding, NotFound, Part, Unexplained

_VOLTS = re.compile(r"([-+±]?)(\d[\d.]*(?:e[-+]?\d+)?) ?(mV|µV|V)\b")
_FACTORS = {"V": 1.0, "mV": 1e-3, "µV": 1e-6}


def finding_in(one: Finding, unit: str) -> Finding:
    """A finding whose sentence and parameters are in `unit` where they were in volts of the output."""
    if unit == "V":
        return one
    return replace(one, says=text_in(one.says, unit), parameters=estimates_in(one.parameters, unit))


def not_found_in(one: NotFound, unit: str) -> NotFound:
    """The same of what was not found."""
    return one if unit == "V" else replace(one, unit=unit_in(one.unit, unit))


def unexplained_in(one: Unexplained, unit: str, part: Part) -> Unexplained:
    """The same of what is unexplained; a drive or a chamber has offsets, no biases."""
    if part != "gyro":
        return replace(one, says=one.says.replace("a bias", "an offset"))
    if unit == "V":
        return one
    models = tuple(
        replace(model, says=text_in(model.says, unit), parameters=estimates_in(model.parameters, unit))
        for model in one.models
    )
    return replace(one, says=text_in(one.says, unit), models=models)


def estimates_in(estimates: Mapping[str, Estimate], unit: str) -> Mapping[str, Estimate]:
    """Estimates whose values stay and whose units follow."""
    return {name: replace(value, unit=unit_in(value.unit, unit)) for name, value in estimates.items()}


def text_in(said: str, unit: str) -> str:
    """A sentence with its voltages in another unit, to three digits."""
    return _VOLTS.sub(lambda found: f"{found[1]}{float(found[2]) * _FACTORS[found[3]]:.3g} {unit}", said)


def unit_in(stated: str, unit: str) -> str:
    """The unit of a parameter: of one that begins with volts, the output's in their place; a supply's volts stay."""
    return unit + stated[1:] if stated == "V" or stated.startswith("V ") else stated
