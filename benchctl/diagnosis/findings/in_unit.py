"""Conversion of sentences and parameters in volts or newton metres to the unit of the measured quantity.

A digital gyro outputs its rate, a servo its load in counts of its PWM.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from benchctl.diagnosis.result import Estimate, Finding, NotFound, Part, Unexplained

_VOLTS = re.compile(r"([-+±]?)(\d[\d.]*(?:e[-+]?\d+)?) ?(mV|µV|V)\b")
_FACTORS = {"V": 1.0, "mV": 1e-3, "µV": 1e-6}
_OWN: Mapping[Part, str] = {"gyro": "V", "drive": "N m", "chamber": "K"}
"""Units that the effects of a part use in their sentences and parameters."""
_OUTPUTS = {"drive": "the torque", "chamber": "the air's temperature"}


def finding_in(one: Finding, unit: str, part: Part) -> Finding:
    """Return a finding with its sentence and parameters in `unit` instead of volts or newton metres."""
    if unit == _OWN[part]:
        return one
    return replace(one, says=text_in(one.says, unit), parameters=estimates_in(one.parameters, unit))


def not_found_in(one: NotFound, unit: str, part: Part) -> NotFound:
    """Return an effect not found with its size in `unit`."""
    return one if unit == _OWN[part] else replace(one, unit=unit_in(one.unit, unit))


def unexplained_in(one: Unexplained, unit: str, part: Part) -> Unexplained:
    """Return the unexplained part in `unit`; for a drive or chamber with "offset" for "bias" and its own output."""
    one = replace(one, says=in_terms_of(one.says, part))
    if unit == _OWN[part]:
        return one
    models = tuple(
        replace(model, says=text_in(model.says, unit), parameters=estimates_in(model.parameters, unit))
        for model in one.models
    )
    return replace(one, says=text_in(one.says, unit), models=models)


def in_terms_of(text: str, part: Part) -> str:
    """Return a sentence about a residual with the terms of its part."""
    if part == "gyro":
        return text
    return text.replace("a bias", "an offset").replace("the bias", "the offset").replace("the output", _OUTPUTS[part])


def pieces_in_time(one: Unexplained) -> Unexplained:
    """Return the unexplained part with "step" replaced by "time", for steps that are pieces of one recorded step."""
    coordinates = dict.fromkeys(word.replace("step", "time") for word in one.coordinates)
    text = one.says.replace("the steps", "time").replace("with the step", "with time")
    text = text.replace(" This recording does not separate it from time.", "")
    return replace(one, coordinates=tuple(coordinates), says=text)


def estimates_in(estimates: Mapping[str, Estimate], unit: str) -> Mapping[str, Estimate]:
    """Return the estimates with converted units; the values are unchanged."""
    return {name: replace(value, unit=unit_in(value.unit, unit)) for name, value in estimates.items()}


def text_in(text: str, unit: str) -> str:
    """Return a sentence with its voltages in another unit, to three digits, and its torque units replaced."""
    text = _VOLTS.sub(lambda found: f"{found[1]}{float(found[2]) * _FACTORS[found[3]]:.3g} {unit}", text)
    return text.replace("N·m", unit)


def unit_in(stated: str, unit: str) -> str:
    """Return a parameter's unit with leading volts or torque replaced by `unit`; a supply's volts are unchanged."""
    own = next((one for one in _OWN.values() if f"{stated} ".startswith(f"{one} ")), None)
    return stated if own is None else unit + stated.removeprefix(own)
