"""Finds the effects that the modules of a package define: one file an effect, no list to keep."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from types import MappingProxyType, ModuleType
from typing import TypeVar

from instruments.physics.effects.effect import DescribedEffect

Kind = TypeVar("Kind", bound=DescribedEffect)


def effects_in(package: ModuleType, kind: type[Kind]) -> MappingProxyType[str, type[Kind]]:
    """Every effect of a kind that a package's modules define, by its identifier, in alphabetical order."""
    found: dict[str, type[Kind]] = {}
    for module in pkgutil.iter_modules(package.__path__):
        for one in vars(importlib.import_module(f"{package.__name__}.{module.name}")).values():
            if inspect.isclass(one) and issubclass(one, kind) and not inspect.isabstract(one):
                found[one.identifier] = one
    return MappingProxyType(dict(sorted(found.items())))
