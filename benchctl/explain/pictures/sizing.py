"""How large an effect is drawn: a usual size where one is known, else one that is seen, found by trying."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from benchctl.explain.glossary import beside
from benchctl.explain.numbers import as_written
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter

Values = dict[str, float]


def stated_values(identifier: str) -> Values:
    """The size at which the glossary asks for an effect to be drawn; empty where it does not."""
    return {name: float(value) for name, value in beside("effects", identifier).get("pictured", {}).items()}


def seen_values(kind: type[DescribedEffect], share: Callable[[Values], float], seen: float) -> Values:
    """Values at which each size of an effect by itself changes a share `seen`; `share` says what values change.

    Shapes are taken from the middle of where a search would begin, phases and choices from its beginning.
    """
    described = kind.parameters
    values = {name: _start(one) for name, one in described.items()}
    for name, one in described.items():
        if one.role != "size":
            continue
        alone = {**values, **{other: 0.0 for other in described if described[other].role == "size"}, name: one.scan[0]}
        changed = share(alone)
        if changed > 0.0:
            values[name] = _within(one, one.scan[0] * seen / changed)
    return values


def said_values(kind: type[DescribedEffect], values: Mapping[str, float]) -> str:
    """Values in a caption: `tau_s = 424, fraction = 0.004`."""
    return ", ".join(f"{name} = {as_written(values[name])}" for name in kind.parameters)


def whole_values(kind: type[DescribedEffect], values: Mapping[str, float]) -> Values:
    """Values with those parameters that they leave out, each where a search would begin."""
    return {**{name: _start(one) for name, one in kind.parameters.items()}, **values}


def _start(one: Parameter) -> float:
    return one.scan[len(one.scan) // 2] if one.role == "shape" else one.scan[0]


def _within(one: Parameter, value: float) -> float:
    return min(max(value, one.low), one.high)
