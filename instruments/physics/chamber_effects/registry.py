"""Registry of the chamber effects."""

from __future__ import annotations

from functools import lru_cache
from types import MappingProxyType

import benchctl_instruments.physics.chamber_effects as package
from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect
from benchctl_instruments.physics.effect_modules import known_effects


@lru_cache(maxsize=1)
def chamber_effects() -> MappingProxyType[str, type[ChamberEffect]]:
    """Return every chamber effect by its identifier, in alphabetical order."""
    return known_effects(package, ChamberEffect)  # type: ignore[type-abstract]  # found by their base class
