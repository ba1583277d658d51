"""The contract of an effect's description, checked whenever an effect is loaded."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields
from typing import Any

from benchctl_instruments.physics.chain import STAGES
from benchctl_instruments.physics.effects.effect import COORDINATES, DescribedEffect, Parameter, PhysicalEffect

_SAID = ("words", "equation", "coordinate", "excited_by")
_LEAST_WORDS = 40


def faults_in(kind: Any, identifier: str) -> Iterator[str]:
    """Yield the faults of the description of an effect that is to be known as `identifier`, in words, worst first."""
    if not _is_effect(kind):
        yield f"it is {kind!r}, expected a class of effects (PhysicalEffect, for one of the gyro)"
        return
    if inspect.isabstract(kind):
        yield f"{kind.__name__} lacks {', '.join(sorted(kind.__abstractmethods__))}"
        return
    if "__dataclass_fields__" not in vars(kind):
        yield "it is no dataclass"
        return
    missing = [name for name in ("identifier", *_SAID, "look_alikes", "parameters") if not hasattr(kind, name)]
    if missing:
        yield f"{kind.__name__} does not define {', '.join(missing)}"
        return
    yield from _wrong_words(kind, identifier)
    yield from _wrong_parameters(kind)


def _is_effect(kind: Any) -> bool:
    return inspect.isclass(kind) and issubclass(kind, DescribedEffect)


def _wrong_words(kind: Any, identifier: str) -> Iterator[str]:
    if kind.identifier != identifier or not identifier.isidentifier():
        yield f"its identifier is {kind.identifier!r}, expected {identifier!r}, a name of letters, digits and _"
    for name in _SAID:
        if not isinstance(getattr(kind, name), str) or not getattr(kind, name):
            yield f"its {name} must be a text, got {getattr(kind, name)!r}"
            return
    if not kind.words.endswith(".") or len(kind.words) <= _LEAST_WORDS:
        yield f"its words must be one or two sentences, got {kind.words!r}"
    parts = kind.coordinate.split("*")
    if len(parts) > 2 or not set(parts) <= set(COORDINATES):
        yield f"its coordinate is {kind.coordinate!r}, expected one or two (a*b) of {', '.join(COORDINATES)}"
    if not isinstance(kind.look_alikes, tuple) or identifier in kind.look_alikes:
        yield f"its look_alikes must be a tuple of the identifiers of others, got {kind.look_alikes!r}"
    if issubclass(kind, PhysicalEffect) and getattr(kind, "stage", None) not in STAGES:
        yield f"its stage is {getattr(kind, 'stage', None)!r}, expected one of {', '.join(STAGES)}"


def _wrong_parameters(kind: Any) -> Iterator[str]:
    stated = kind.parameters
    if not isinstance(stated, Mapping) or not all(isinstance(one, Parameter) for one in stated.values()) or not stated:
        yield f"its parameters must be a mapping from names to Parameter, got {stated!r}"
        return
    its_fields = fields(kind)
    if [field.name for field in its_fields[: len(stated)]] != list(stated):
        yield f"its fields must be its parameters ({', '.join(stated)}) and then its circumstances"
    for field in its_fields:
        if field.name not in stated and field.default is MISSING:
            yield f"its field {field.name} is no parameter, and has no default"
    for name, parameter in stated.items():
        for fault in _wrong_parameter(parameter):
            yield f"its parameter {name} {fault}"
    if issubclass(kind, PhysicalEffect) and all(parameter.zero is None for parameter in stated.values()):
        yield "none of its parameters has a zero, at which it is gone"


def _wrong_parameter(parameter: Parameter) -> Iterator[str]:
    low, high, zero = parameter.low, parameter.high, parameter.zero
    if not parameter.unit or not parameter.meaning:
        yield "has no unit or no meaning"
    if not -math.inf < low < high < math.inf:
        yield f"lies between {low} and {high}, expected two finite bounds in order"
    if not parameter.scan or not all(low <= value <= high for value in parameter.scan):
        yield f"begins a search at {parameter.scan}, expected values from {low} to {high}"
    if parameter.logarithmic and low <= 0.0:
        yield f"is logarithmic, and its lower bound is {low}"
    if parameter.role == "size" and (zero is None or len(parameter.scan) != 1 or parameter.scan[0] == zero):
        yield f"is a size: expected a zero and one other value to begin with, got {zero} and {parameter.scan}"
    if parameter.role == "phase" and (parameter.unit != "degree" or high - low != 360.0):
        yield f"is a phase: expected 360 degree, got {high - low:g} {parameter.unit}"
