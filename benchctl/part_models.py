"""A lab's models of its table's drive and of its chamber: tables of numbers with checked names.

In a model file they are `[parts.drive]` and `[parts.chamber]`, with tables such as
`[parts.drive.effects.coulomb_friction]` for additional effects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from benchctl.limits import shown
from benchctl_instruments.errors import UsageError

EFFECTS = "effects"


def numbers_of(
    table: Mapping[str, Any] | None, name: str, needed: Sequence[str], further: Sequence[str] = ()
) -> dict[str, float]:
    """Return the numbers of a table without its effects; it must contain all `needed` fields or none of them.

    Raises `UsageError` that names a field that is unknown, missing, or not a finite number.
    """
    if not isinstance(table, Mapping | None):
        raise UsageError(f"[{name}]: expected a table of numbers, got {shown(table)}")
    stated = {field: value for field, value in (table or {}).items() if field != EFFECTS}
    for field, value in stated.items():
        if field not in (*needed, *further):
            raise UsageError(f"[{name}] {field}: no such field; there are {', '.join((*needed, *further))}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise UsageError(f"[{name}] {field}: expected a finite number, got {shown(value)}")
    missing = [field for field in needed if field not in stated]
    if missing and len(missing) < len(needed):
        raise UsageError(f"[{name}] {missing[0]}: this field is missing; the other fields require it")
    return {field: float(value) for field, value in stated.items()}


def check_parts(parts: Mapping[str, Any]) -> None:
    """Raise a `UsageError` that names the part, effect or parameter if one is invalid.

    The numbers that a part itself needs depend on the recorded channels and are checked by a diagnosis.
    """
    from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
    from benchctl_instruments.physics.drive_effects.registry import drive_effects
    from benchctl_instruments.physics.effects.effect import DescribedEffect
    from benchctl_instruments.physics.effects.numbered import identifier_in
    from benchctl_instruments.physics.structure_places import OF_PARTS
    from benchctl_instruments.physics.structures import Structure, structure_named

    known: dict[str, Mapping[str, type[DescribedEffect]]] = {"drive": drive_effects(), "chamber": chamber_effects()}
    for part, table in parts.items():
        if part not in known:
            raise UsageError(f"[parts] {part}: no such part; there are {', '.join(known)}")
        place = f"parts.{part}"
        if not isinstance(table, Mapping):
            raise UsageError(f"[parts] {part}: expected a table, got {shown(table)}")
        effects = table.get(EFFECTS, {})
        if not isinstance(effects, Mapping):
            raise UsageError(f"[{place}] {EFFECTS}: expected a table, got {shown(effects)}")
        for name, values in effects.items():
            kind = known[part].get(identifier_in(name, known[part])) or structure_named(name)
            if kind is None or (issubclass(kind, Structure) and OF_PARTS.get(kind.acts_on) != part):
                raise UsageError(f"[{place}.{EFFECTS}] {name}: no such effect; there are {', '.join(known[part])}")
            if not isinstance(values, Mapping):
                raise UsageError(f"[{place}.{EFFECTS}] {name}: expected a table, got {shown(values)}")
            numbers_of(values, f"{place}.{EFFECTS}.{name}", tuple(kind.parameters))
