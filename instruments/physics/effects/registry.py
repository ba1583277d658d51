"""Finds the effects: those that a module of this package defines, and those of the entry points `benchctl.effects`."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import entry_points
from types import MappingProxyType

import instruments.physics.effects as package
from instruments.errors import UsageError
from instruments.physics.effect_modules import effects_in
from instruments.physics.effects.effect import PhysicalEffect

GROUP = "benchctl.effects"


@lru_cache(maxsize=1)
def effects() -> MappingProxyType[str, type[PhysicalEffect]]:
    """Every effect by its identifier, in alphabetical order; one of ours is not replaced by one of an entry point."""
    found = dict(effects_in(package, PhysicalEffect))  # type: ignore[type-abstract]  # the base is what they are found by
    for point in entry_points(group=GROUP):
        kind = point.load()
        found.setdefault(kind.identifier, kind)
    return MappingProxyType(dict(sorted(found.items())))


def effect(identifier: str) -> type[PhysicalEffect]:
    """The effect of an identifier; `UsageError` where there is none."""
    known = effects()
    if identifier not in known:
        raise UsageError(f"effect {identifier!r}: there is no such effect; there are {', '.join(known)}")
    return known[identifier]
