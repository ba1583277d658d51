"""What was looked for and not found: of each effect the size that this recording would have shown."""

from __future__ import annotations

import math
from collections.abc import Collection

from benchctl.diagnosis.result import NotFound
from benchctl.diagnosis.search.screen import Scored
from benchctl.diagnosis.search.selection import Selection

_POWER_95 = 1.645
"""So many deviations above the threshold an effect is missed one time in twenty."""


def not_found_of(chosen: Selection, found: Collection[str]) -> tuple[NotFound, ...]:
    """For each other effect, at the place where it shows best, the size that would have passed the threshold."""
    shown: dict[str, NotFound] = {}
    for one in chosen.screening.scored:
        kind = one.probe.kind
        if kind.identifier in found or not one.probe.sizes:
            continue
        level = math.sqrt(chosen.screening.threshold + 2.0 * math.log(one.probe.places)) + _POWER_95
        name = next(name for name, parameter in kind.parameters.items() if parameter.role == "size")
        power = float(one.power[0])
        smallest = one.probe.sizes[0] * level / math.sqrt(power) if power > 0.0 else None
        known = shown.get(kind.identifier)
        if known is not None and (smallest is None or (known.smallest or math.inf) <= smallest):
            continue
        shown[kind.identifier] = NotFound(
            effect=kind.identifier,
            parameter=name,
            smallest=smallest,
            unit=kind.parameters[name].unit,
            others={
                other: value
                for other, value in one.probe.columns[0].values.items()
                if kind.parameters[other].role in ("shape", "choice")
            },
            says=_why(one) if smallest is None else "",
        )
    return tuple(shown.values())


def _why(unseen: Scored) -> str:
    """Why an effect could not be seen at all."""
    if unseen.followed:
        return "Part of the lab's model already: its own parameters follow it."
    return f"Not observable in this recording: it needs {unseen.probe.kind.excited_by}."
