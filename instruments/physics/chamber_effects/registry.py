"""Finds the effects of a chamber."""

from __future__ import annotations

from functools import lru_cache
from types import MappingProxyType

import benchctl_instruments.physics.chamber_effects as package
from benchctl_instruments.physics.chamber_effects.effect import ChamberEffect
from benchctl_instruments.physics.effect_modules import known_effects


@lru_cache(maxsize=1)
def chamber_effects() -> MappingProxyType[str, type[ChamberEffect]]:
    """Every effect of a chamber by its identifier, in alphabetical order."""
    return known_effects(package, ChamberEffect)  # type: ignore[type-abstract]  # the base is what they are found by
