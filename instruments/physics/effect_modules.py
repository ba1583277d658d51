"""Find effects: those defined by the modules of a package, one module per effect, and those of other packages."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import lru_cache
from types import MappingProxyType, ModuleType
from typing import TypeVar

from benchctl_instruments.entry_points import Offer, leave_out, leave_out_clash, offers
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effect_contract.description import faults_in
from benchctl_instruments.physics.effects.effect import DescribedEffect

GROUP = "benchctl.effects"
_PACKAGES = ("effects", "drive_effects", "chamber_effects")

Kind = TypeVar("Kind", bound=DescribedEffect)


def known_effects(package: ModuleType, kind: type[Kind]) -> MappingProxyType[str, type[Kind]]:
    """Return every effect of a kind by identifier, in alphabetical order: of the package and of the entry points."""
    found = dict(effects_in(package, kind))
    for identifier, one in _theirs().items():
        if issubclass(one, kind):
            found[identifier] = one
    return MappingProxyType(dict(sorted(found.items())))


def effects_in(package: ModuleType, kind: type[Kind]) -> MappingProxyType[str, type[Kind]]:
    """Return every effect of a kind that a package's modules define, by identifier, in alphabetical order."""
    found: dict[str, type[Kind]] = {}
    for module in pkgutil.iter_modules(package.__path__):
        for name, one in vars(importlib.import_module(f"{package.__name__}.{module.name}")).items():
            public = inspect.isclass(one) and not name.startswith("_")
            if public and issubclass(one, kind) and not inspect.isabstract(one):
                found[one.identifier] = one
    return MappingProxyType(dict(sorted(found.items())))


def refuse_broken(identifier: str) -> None:
    """Raise `UsageError` if `identifier` is an effect of another package that cannot be used."""
    offer = offers(GROUP).get(identifier)
    if offer is not None and identifier not in _theirs():
        _loaded(offer)


@lru_cache(maxsize=1)
def _theirs() -> dict[str, type[DescribedEffect]]:
    """Return the effects of other packages; unusable ones are omitted and logged."""
    found: dict[str, type[DescribedEffect]] = {}
    added = offers(GROUP)
    ours = _ours() if added else frozenset()
    for identifier, offer in added.items():
        if identifier in ours:
            leave_out_clash(offer)
            continue
        try:
            found[identifier] = _loaded(offer)
        except UsageError as err:
            leave_out(offer, f"left out: {str(err).partition(': ')[2]}")
    return found


def _loaded(offer: Offer) -> type[DescribedEffect]:
    kind = offer.load()
    for fault in faults_in(kind, offer.point.name):
        raise offer.refused(f"{fault}; benchctl_instruments.physics.effect_contract describes what an effect must keep")
    loaded: type[DescribedEffect] = kind
    return loaded


def _ours() -> frozenset[str]:
    """Return the identifiers of all built-in effects, of every part of the bench."""
    packages = [importlib.import_module(f"benchctl_instruments.physics.{name}") for name in _PACKAGES]
    return frozenset(identifier for package in packages for identifier in effects_in(package, DescribedEffect))  # type: ignore[type-abstract]  # found by their base class
