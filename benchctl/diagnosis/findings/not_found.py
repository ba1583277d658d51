"""What was looked for and not found: of each effect the size that this recording was seen to show.

A size is stated only where an effect of that size, put into the recording, is found again by the score that decides:
in either direction, beside everything that is left. Where something unexplained is left nothing is excluded, for it may
be the very effect.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

from benchctl.diagnosis.result import NotFound
from benchctl.diagnosis.search.injection import Injection
from benchctl.diagnosis.search.probes import Probe
from benchctl.diagnosis.search.screen import Scored
from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.problem import Problem
from benchctl.side_by_side import shared_out
from benchctl_instruments.physics.effects.effect import DescribedEffect

_POWER_95 = 1.645
"""So many deviations above the threshold an effect is missed one time in twenty."""
_LARGER = (1.0, 1.4, 2.0, 2.8, 4.0)
"""What is not found again is tried so many times as large."""


def not_found_of(
    problem: Problem, chosen: Selection, stated: Collection[str], *, unexplained: bool
) -> tuple[NotFound, ...]:
    """For each effect that is not `stated`, as a finding or its alternative, the size at which it was found again.

    Of many places the one where it shows best is meant. None where something unexplained is left, or a disturbance
    follows what was put in.
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
    looked = shared_out(lambda one: _recovered(problem, chosen, one[1].probe, one[0]), list(best.values()))
    return tuple(one for one in looked if one is not None)


def unseen_in(chosen: Selection, stated: Collection[str]) -> Iterator[str]:
    """A sentence on the effects that no size of would show, and why; nothing where there is none."""
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


def _recovered(problem: Problem, chosen: Selection, probe: Probe, size: float) -> NotFound | None:
    """The smallest size from this one on at which an injected effect is found again; None where none is."""
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
    """The effect of a size in each direction that it can have; none where its range does not hold the size."""
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
