"""The content of a picture as data: panels of curves above each other, with a caption."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from benchctl.explain.glossary import as_written, extra
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter

Look = Literal["off", "on", "third", "grey", "off dots", "on dots"]
"""`off` is without the effect, `on` with it; `grey` is for the background."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SketchedCurve:
    """A line or dots; x and y of shape (n,)."""

    x: FloatArray
    y: FloatArray
    look: Look
    label: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One pair of axes; `share` is its relative height."""

    x: str
    y: str
    curves: tuple[SketchedCurve, ...]
    logarithmic: bool = False
    zero: bool = False
    share: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sketch:
    """A complete picture; `difference`, shape (n,), is the change due to the effect."""

    title: str
    caption: str
    panels: tuple[Panel, ...]
    difference: FloatArray


def compared(x: FloatArray, x_label: str, off: FloatArray, on: FloatArray, y: str, *, difference: str) -> list[Panel]:
    """Return a panel with the curves with and without the effect, and a panel with their difference."""
    both = (
        SketchedCurve(x=x, y=off, look="off", label="without the effect"),
        SketchedCurve(x=x, y=on, look="on", label="with it"),
    )
    factor = 1e3 if difference.startswith("m") else 1.0
    changed = (SketchedCurve(x=x, y=factor * (on - off), look="on"),)
    return [
        Panel(x=x_label, y=y, curves=both),
        Panel(x=x_label, y=f"difference ({difference})", curves=changed, zero=True, share=0.8),
    ]


def title_of(kind: type[DescribedEffect]) -> str:
    """Return an effect's identifier as a heading."""
    return kind.identifier.replace("_", " ").capitalize()


Values = dict[str, float]


def stated_values(identifier: str) -> Values:
    """Return the size at which the glossary requests an effect to be drawn; empty if it does not."""
    return {name: float(value) for name, value in extra("effects", identifier).get("pictured", {}).items()}


def visible_values(kind: type[DescribedEffect], share: Callable[[Values], float], target: float) -> Values:
    """Return values at which each size of an effect alone changes a share `target`; `share` computes it from values.

    Shapes are taken from the middle of the search grid, phases and choices from its start.
    """
    described = kind.parameters
    values = {name: _start(one) for name, one in described.items()}
    for name, one in described.items():
        if one.role != "size":
            continue
        alone = {**values, **{other: 0.0 for other in described if described[other].role == "size"}, name: one.scan[0]}
        changed = share(alone)
        if changed > 0.0:
            values[name] = _within(one, one.scan[0] * target / changed)
    return values


def described_values(kind: type[DescribedEffect], values: Mapping[str, float]) -> str:
    """Format values for a caption: `tau_s = 424, fraction = 0.004`."""
    return ", ".join(f"{name} = {as_written(values[name])}" for name in kind.parameters)


def whole_values(kind: type[DescribedEffect], values: Mapping[str, float]) -> Values:
    """Complete values with the missing parameters, each at the start of its search grid."""
    return {**{name: _start(one) for name, one in kind.parameters.items()}, **values}


def _start(one: Parameter) -> float:
    return one.scan[len(one.scan) // 2] if one.role == "shape" else one.scan[0]


def _within(one: Parameter, value: float) -> float:
    return min(max(value, one.low), one.high)
