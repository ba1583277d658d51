"""Registry of the effects: those defined in this package, and those of the entry points `benchctl.effects`."""

from __future__ import annotations

from functools import lru_cache
from types import MappingProxyType

import benchctl_instruments.physics.effects as package
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effect_modules import known_effects, refuse_broken
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.structure_places import OF_PARTS
from benchctl_instruments.physics.structures import structure_named


@lru_cache(maxsize=1)
def effects() -> MappingProxyType[str, type[PhysicalEffect]]:
    """Return every effect by identifier, in alphabetical order; entry points cannot replace a built-in effect."""
    return known_effects(package, PhysicalEffect)  # type: ignore[type-abstract]  # found by their base class


def effect(identifier: str) -> type[PhysicalEffect]:
    """Return the gyro effect with an identifier, or the structure.

    Raises `UsageError` if there is none, or one of another package that cannot be used.
    """
    known = effects()
    made = None if identifier in known else structure_named(identifier)
    if made is not None and made.acts_on not in OF_PARTS:
        return made
    if identifier not in known:
        refuse_broken(identifier)
        raise UsageError(f"effect {identifier!r}: there is no such effect; there are {', '.join(known)}")
    return known[identifier]
