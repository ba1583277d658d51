"""Names of several effects of one kind: `encoder_eccentricity`, `encoder_eccentricity_2`, `encoder_eccentricity_3`."""

from __future__ import annotations

import re
from collections.abc import Mapping

from benchctl_instruments.physics.effects.effect import DescribedEffect

_NUMBERED = re.compile(r"(?P<identifier>.+)_(?P<number>[2-9]|[1-9]\d+)", re.ASCII)


def numbered(identifier: str, number: int) -> str:
    """Return the name of the first, second, … effect of a kind; the first one has the identifier as name."""
    return identifier if number == 1 else f"{identifier}_{number}"


def identifier_in(name: str, known: Mapping[str, type[DescribedEffect]]) -> str:
    """Return the identifier of an effect that a table names; a name without number is returned unchanged.

    Numbers are recognized only for kinds that allow `several` effects.
    """
    match = _NUMBERED.fullmatch(name)
    if name in known or match is None:
        return name
    kind = known.get(match["identifier"])
    return name if kind is None or not kind.several else kind.identifier
