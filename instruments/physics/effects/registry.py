"""Finds the effects: those that a module of this package defines, and those of the entry points `benchctl.effects`."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import lru_cache
from importlib.metadata import entry_points
from types import MappingProxyType

import instruments.physics.effects as package
from instruments.errors import UsageError
from instruments.physics.effects.effect import PhysicalEffect

GROUP = "benchctl.effects"


@lru_cache(maxsize=1)
def effects() -> MappingProxyType[str, type[PhysicalEffect]]:
    """Every effect by its identifier, in alphabetical order; one of ours is not replaced by one of an entry point."""
    found: dict[str, type[PhysicalEffect]] = {}
    for module in pkgutil.iter_modules(package.__path__):
        for kind in vars(importlib.import_module(f"{package.__name__}.{module.name}")).values():
            if inspect.isclass(kind) and issubclass(kind, PhysicalEffect) and not inspect.isabstract(kind):
                found[kind.identifier] = kind
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
