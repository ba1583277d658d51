"""Registry of the drive effects."""

from __future__ import annotations

from functools import lru_cache
from types import MappingProxyType

import benchctl_instruments.physics.drive_effects as package
from benchctl_instruments.physics.drive_effects.effect import DriveEffect
from benchctl_instruments.physics.effect_modules import known_effects


@lru_cache(maxsize=1)
def drive_effects() -> MappingProxyType[str, type[DriveEffect]]:
    """Return every drive effect by its identifier, in alphabetical order."""
    return known_effects(package, DriveEffect)  # type: ignore[type-abstract]  # found by their base class
