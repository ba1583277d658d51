"""Effects tested and not found: for each the size that this recording would have shown.

A size is stated only if an effect of that size, added to the recording, satisfies the criteria of a finding, in either
direction and with the complete residual. If anything is unexplained, no effect is excluded, as it may be that effect.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

from benchctl.diagnosis.result import NotFound
from benchctl.diagnosis.search.injection import Injection
from benchctl.diagnosis.search.probes import Probe
from benchctl.diagnosis.search.screen import Scored
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.side_by_side import shared_out
from benchctl_instruments.physics.effects.effect import DescribedEffect

_POWER_95 = 1.645
"""Number of deviations above the threshold at which an effect is missed once in twenty cases."""
_LARGER = (1.0, 1.4, 2.0, 2.8, 4.0)
"""Factors by which the size is increased until the effect is detected."""


def not_found_of(
    problem: PartProblem, chosen: Selection, stated: Collection[str], *, unexplained: bool
) -> tuple[NotFound, ...]:
    """Return the size at which each effect that is not `stated`, as finding or alternative, was detected.

    Of several places the most sensitive one is used. Nothing is returned if something is unexplained, or if a
    disturbance would follow the added effect.
    """
    if unexplained or problem.disturbed:
        return ()
    best: dict[str, tuple[float, Scored]] = {}
    for one in chosen.screening.scored:
        kind, power = one.probe.kind, float(one.power[0]) if one.probe.sizes else 0.0
        if kind.identifier in stated or power <= 0.0:
            continue
        level = math.sqrt(chosen.least + 2.0 * math.log(one.probe.places)) + _POWER_95
        size = one.probe.sizes[0] * level / math.sqrt(power)
        if kind.identifier not in best or size < best[kind.identifier][0]:
            best[kind.identifier] = size, one
    recovered = shared_out(lambda one: _recovered(problem, chosen, one[1].probe, one[0]), list(best.values()))
    return tuple(one for one in recovered if one is not None)


def unseen_in(chosen: Selection, stated: Collection[str]) -> Iterator[str]:
    """Yield a sentence on the effects that would not show at any size, and why; nothing if there are none."""
    of_kind: dict[str, list[Scored]] = {}
    for one in chosen.screening.scored:
        if one.probe.sizes and one.probe.identifier not in stated:
            of_kind.setdefault(one.probe.identifier, []).append(one)
    blind = {name: some for name, some in of_kind.items() if not any(one.power[0] > 0.0 for one in some)}
    if blind:
        why = "; ".join(
            f"{name} ({'the model follows it' if any(one.followed for one in some) else _needs(some[0])})"
            for name, some in blind.items()
        )
        yield f"Not observable in this recording: {why}."


def _needs(one: Scored) -> str:
    return f"it needs {one.probe.kind.excited_by}"


def _recovered(problem: PartProblem, chosen: Selection, probe: Probe, size: float) -> NotFound | None:
    """Return the smallest size, from `size` on, at which an injected effect is detected; None if there is none."""
    kind = probe.kind
    name = next(name for name, parameter in kind.parameters.items() if parameter.role == "size")
    injection = Injection.of(problem, chosen, probe)
    for larger in _LARGER:
        effects = list(_of_size(probe, name, larger * size))
        if effects and all(injection.found_again(one) for one in effects):
            return NotFound(
                effect=kind.identifier,
                parameter=name,
                smallest=larger * size,
                unit=kind.parameters[name].unit,
                others={
                    other: value
                    for other, value in probe.columns[0].values.items()
                    if kind.parameters[other].role in ("shape", "choice")
                },
            )
    return None


def _of_size(probe: Probe, name: str, size: float) -> Iterator[DescribedEffect]:
    """Yield the effect of a size in each direction that it can have; none if its range excludes the size."""
    parameter = probe.kind.parameters[name]
    first = probe.columns[0].values
    phase = next((other for other, one in probe.kind.parameters.items() if one.role == "phase"), None)
    if size >= parameter.high:
        return
    if phase is None:
        signed = [size, -size] if -size > parameter.low else [size]
        for value in signed:
            yield probe.kind.make(first | {name: value}, probe.circumstances)
        return
    turn = 360.0 / first.get("order", 1.0)
    for quarter in range(4):
        yield probe.kind.make(first | {name: size, phase: quarter * turn / 4.0}, probe.circumstances)
