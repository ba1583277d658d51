"""What tells the effects of a model apart: of most kinds there is one, of some as many as there are orders."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.effects.numbered import numbered

Place = tuple[str, tuple[float, ...]]
"""The identifier of an effect and its choices, which no fit moves."""


def keys_of(effects: Sequence[DescribedEffect]) -> tuple[str, ...]:
    """Names that differ, in the order of the effects: the identifier, of a second of its kind `identifier_2`."""
    return keys_of_names([effect.identifier for effect in effects])


def keys_of_names(identifiers: Iterable[str]) -> tuple[str, ...]:
    """The same of identifiers, as findings state them."""
    seen: Counter[str] = Counter()
    keys = []
    for identifier in identifiers:
        seen[identifier] += 1
        keys.append(numbered(identifier, seen[identifier]))
    return tuple(keys)


def tables_of(effects: Sequence[DescribedEffect]) -> dict[str, dict[str, float]]:
    """Effects as the tables of a model file: their parameters by key."""
    return dict(zip(keys_of(effects), (effect.values for effect in effects), strict=True))


def place_of(effect: DescribedEffect) -> Place:
    """What stays of an effect when it is fitted: by it a search knows it again."""
    chosen = (name for name, parameter in effect.parameters.items() if parameter.role == "choice")
    return effect.identifier, tuple(effect.values[name] for name in chosen)


def may_join(effect: DescribedEffect, present: Iterable[DescribedEffect]) -> bool:
    """Whether a model may have an effect beside those that it has: another of its kind only at other choices."""
    own = [one for one in present if one.identifier == effect.identifier]
    return not own or (effect.several and place_of(effect) not in [place_of(one) for one in own])
