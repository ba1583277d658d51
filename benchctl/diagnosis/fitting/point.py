"""A model as a point that a fit moves: the baseline's numbers and those of its effects, each in its own scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from instruments.physics.effects.effect import DescribedEffect, Parameter

FloatArray = npt.NDArray[np.float64]

_SMALLEST = 1e-300
"""Below it a number that is moved in its logarithm does not go."""


@dataclass(frozen=True, slots=True)
class Free:
    """One number that is fitted: a parameter of the baseline (`effect` is None) or of the effect at a place."""

    name: str
    effect: int | None
    parameter: Parameter | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A model: the baseline's parameters, shape (p,), and effects."""

    baseline: FloatArray
    effects: tuple[DescribedEffect, ...] = ()

    def free(self, names: Sequence[str]) -> list[Free]:
        """Everything that can be fitted at this point; `names` are those of the baseline."""
        numbers = [Free(name, None, None) for name in names]
        for place, effect in enumerate(self.effects):
            numbers += [
                Free(name, place, parameter)
                for name, parameter in effect.parameters.items()
                if parameter.role != "choice"
            ]
        return numbers

    def value(self, number: Free, index: int) -> float:
        """The present value of a free number, in the scale in which it is moved."""
        if number.effect is None:
            return float(self.baseline[index])
        value = float(getattr(self.effects[number.effect], number.name))
        return math.log(max(value, _SMALLEST)) if _in_logarithms(number) else value

    def moved(self, numbers: Sequence[Free], values: FloatArray) -> Point:
        """The model with its free numbers at other values, each kept within its bounds."""
        baseline = self.baseline.copy()
        effects = list(self.effects)
        for index, (number, value) in enumerate(zip(numbers, values.tolist(), strict=True)):
            if number.effect is None:
                baseline[index] = value
            else:
                effects[number.effect] = replace(  # type: ignore[type-var]  # every effect is a dataclass
                    effects[number.effect], **{number.name: _bounded(number, value)}
                )
        return Point(baseline=baseline, effects=tuple(effects))


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
