"""A model as a point that a fit moves: the numbers of the baseline and of its effects, each in its own scale."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter

_SMALLEST = 1e-300
"""Lower limit of a number that is fitted in its logarithm."""
FREE = 50.0
"""Error of a logarithm above which a number is not determined at all."""
_AT = 1e-3
"""Relative distance from a bound below which a number is at the bound."""


@dataclass(frozen=True, slots=True)
class Free:
    """One number that is fitted: a parameter of the baseline (`effect` is None) or of the effect with this index.

    `low` and `high` bound a parameter of the baseline; the bounds of an effect's are in its `parameter`.
    """

    name: str
    effect: int | None
    parameter: Parameter | None
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A model: the baseline's parameters, shape (p,), and effects."""

    baseline: FloatArray
    effects: tuple[DescribedEffect, ...] = ()

    def free(self, names: Sequence[str], bounds: Mapping[str, tuple[float, float]] | None = None) -> list[Free]:
        """Return all numbers that can be fitted; `names` are those of the baseline, some with `bounds`."""
        within = bounds or {}
        numbers = [Free(name, None, None, *within.get(name, (-math.inf, math.inf))) for name in names]
        for place, effect in enumerate(self.effects):
            numbers += [
                Free(name, place, parameter)
                for name, parameter in effect.parameters.items()
                if parameter.role not in ("choice", "assumed")
            ]
        return numbers

    def value(self, number: Free, index: int) -> float:
        """Return the value of a free number, in the scale of the fit."""
        if number.effect is None:
            return float(self.baseline[index])
        value = float(getattr(self.effects[number.effect], number.name))
        return math.log(max(value, _SMALLEST)) if _in_logarithms(number) else value

    def values(self, numbers: Sequence[Free]) -> FloatArray:
        """Return the values of free numbers, each in the scale of the fit, shape (p,)."""
        return np.array([self.value(number, i) for i, number in enumerate(numbers)])

    def moved(self, numbers: Sequence[Free], values: FloatArray) -> Point:
        """Return the model with its free numbers at other values, each kept within its bounds."""
        baseline = self.baseline.copy()
        effects = list(self.effects)
        for index, (number, value) in enumerate(zip(numbers, values.tolist(), strict=True)):
            if number.effect is None:
                baseline[index] = min(max(value, number.low), number.high)
            else:
                effects[number.effect] = replace(  # type: ignore[type-var]  # every effect is a dataclass
                    effects[number.effect], **{number.name: _bounded(number, value)}
                )
        return Point(baseline=baseline, effects=tuple(effects))


def at_bound(effect: DescribedEffect) -> bool:
    """Return whether a parameter of an effect is at a bound of what is plausible; `choice` and phase have no bounds."""
    return bool(_at_bounds(effect)) or not effect.plausible


def _at_bounds(effect: DescribedEffect) -> list[str]:
    return [
        name
        for name, parameter in effect.parameters.items()
        if parameter.role in ("size", "shape") and stands_at(effect.values[name], parameter.low, parameter.high)
    ]


def assumed(point: Point) -> Point:
    """Return the model with undetermined parameters of effects assumed; the same object if there are none."""
    effects = tuple(((names := _at_bounds(one)) and one.assuming(names)) or one for one in point.effects)
    return point if effects == point.effects else replace(point, effects=effects)


def stands_at(value: float, low: float, high: float) -> bool:
    """Return whether a number is at one of its bounds, within tolerance; never at an infinite bound."""
    return any(math.isfinite(end) and abs(end - value) <= _AT * abs(end) for end in (low, high))


def interval_of(parameter: Parameter, value: float, half: float) -> tuple[float, float]:
    """Return the interval of a number whose error is `half` to each side in the scale of the fit.

    The interval of a `relative` one is given by ratios: the size of a large change may be uncertain and its sign sure.
    """
    if parameter.logarithmic:
        return value * math.exp(-min(half, FREE)), value * math.exp(min(half, FREE))
    ratio = 1.0 + value
    if parameter.relative and ratio > 0.0:
        share = min(half / ratio, FREE)
        return ratio * math.exp(-share) - 1.0, ratio * math.exp(share) - 1.0
    return value - half, value + half


def _in_logarithms(number: Free) -> bool:
    return number.parameter is not None and number.parameter.logarithmic


def _bounded(number: Free, value: float) -> float:
    parameter = number.parameter
    if parameter is None:
        return value
    if parameter.role == "phase":
        return value % 360.0
    if parameter.logarithmic:
        value = max(math.exp(min(value, 700.0)), _SMALLEST)
    return min(max(value, parameter.low), parameter.high)
