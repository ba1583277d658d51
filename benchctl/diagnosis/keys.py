"""Unique keys for the effects of a model: most kinds occur once, some occur once per order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.effects.numbered import numbered

Place = tuple[str, tuple[float, ...]]
"""The identifier of an effect and its choices, which a fit does not change."""


def keys_of(effects: Sequence[DescribedEffect]) -> tuple[str, ...]:
    """Return unique names in the order of the effects: the identifier, and `identifier_2` for the second of a kind."""
    return keys_of_names([effect.identifier for effect in effects])


def keys_of_names(identifiers: Iterable[str]) -> tuple[str, ...]:
    """Return the same for identifiers, as findings state them."""
    counts: Counter[str] = Counter()
    keys = []
    for identifier in identifiers:
        counts[identifier] += 1
        keys.append(numbered(identifier, counts[identifier]))
    return tuple(keys)


def tables_of(effects: Sequence[DescribedEffect]) -> dict[str, dict[str, float]]:
    """Return the effects as tables of a model file: their parameters by key."""
    return dict(zip(keys_of(effects), (effect.values for effect in effects), strict=True))


def place_of(effect: DescribedEffect) -> Place:
    """Return the part of an effect that a fit does not change; a search identifies the effect by it."""
    chosen = (name for name, parameter in effect.parameters.items() if parameter.role == "choice")
    return effect.identifier, tuple(effect.values[name] for name in chosen)


def may_join(effect: DescribedEffect, present: Iterable[DescribedEffect]) -> bool:
    """Return whether a model may add an effect: a second one of the same kind only with other choices."""
    own = [one for one in present if one.identifier == effect.identifier]
    return not own or (effect.several and place_of(effect) not in [place_of(one) for one in own])
