"""Probes, the starting places of the search for an effect: a few parameter values that cover the likely range."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from benchctl.diagnosis.stepped import PartProblem
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class Probe:
    """One starting place: an effect for each column that its sizes and phases give there.

    `sizes` are the sizes for which the columns were computed; empty for an effect without size, whose single column is
    the complete effect. `places` is the number of independent places among which the data chose this one: the
    contribution of chance increases with it. `pulled` is the gain that a residual scan promised for the place, as a
    wrong fit without the effect can hide it from other tests.
    """

    kind: type[DescribedEffect]
    columns: tuple[DescribedEffect, ...]
    sizes: tuple[float, ...]
    circumstances: dict[str, float]
    places: float = 1.0
    pulled: float = 0.0

    @property
    def identifier(self) -> str:
        """Identifier of the effect."""
        return self.kind.identifier

    def start(self, weights: FloatArray) -> DescribedEffect:
        """Return the effect that is the sum of the columns, each multiplied by its weight, shape (columns,)."""
        if not self.sizes:
            return self.columns[0]
        values = self.columns[0].values
        names = _of_role(self.kind, "size")
        phases = _of_role(self.kind, "phase")
        if phases:
            order = float(getattr(self.columns[0], "order", 1.0))
            values[names[0]] = float(np.hypot(*weights)) * self.sizes[0]
            values[phases[0]] = math.degrees(math.atan2(weights[1], weights[0])) % 360.0 / order
        else:
            for name, weight, size in zip(names, weights, self.sizes, strict=True):
                parameter = self.kind.parameters[name]
                values[name] = min(max(float(weight) * size, parameter.low), parameter.high)
        return self.kind.make(values, self.circumstances)


def probes_of(problem: PartProblem, kind: type[DescribedEffect]) -> Iterator[Probe]:
    """Yield the probes of an effect in a problem; none for effects whose places are proposed by a scan."""
    if any(parameter.by_scan for parameter in kind.parameters.values()):
        return
    held = [name for name, parameter in kind.parameters.items() if parameter.role in ("shape", "choice")]
    for place in itertools.product(*(kind.parameters[name].scan for name in held)):
        yield probe_at(problem, kind, dict(zip(held, place, strict=True)))


def probe_at(
    problem: PartProblem, kind: type[DescribedEffect], place: Mapping[str, float], *, places: float = 1.0
) -> Probe:
    """Return the probe at values of the shapes and choices, selected among so many independent places."""
    sizes, phases = _of_role(kind, "size"), _of_role(kind, "phase")
    circumstances = dict(problem.circumstances)
    values = dict.fromkeys(sizes, 0.0) | dict.fromkeys(phases, 0.0) | dict(place)
    if not sizes:
        columns = [kind.make(values, circumstances)]
        scale: list[float] = []
    elif phases:
        size = kind.parameters[sizes[0]].scan[0]
        quarter = 90.0 / values.get("order", 1.0)
        columns = [kind.make(values | {sizes[0]: size, phases[0]: phase}, circumstances) for phase in (0.0, quarter)]
        scale = [size, size]
    else:
        scale = [kind.parameters[name].scan[0] for name in sizes]
        columns = [kind.make(values | {name: size}, circumstances) for name, size in zip(sizes, scale, strict=True)]
    return Probe(kind=kind, columns=tuple(columns), sizes=tuple(scale), circumstances=circumstances, places=places)


def _of_role(kind: type[DescribedEffect], role: str) -> list[str]:
    return [name for name, parameter in kind.parameters.items() if parameter.role == role]
