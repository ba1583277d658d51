"""Names for several effects of one kind: `encoder_eccentricity`, `encoder_eccentricity_2`, `encoder_eccentricity_3`."""

from __future__ import annotations

import re
from collections.abc import Mapping

from benchctl_instruments.physics.effects.effect import DescribedEffect

_NUMBERED = re.compile(r"(?P<identifier>.+)_(?P<number>[2-9]|[1-9]\d+)", re.ASCII)


def numbered(identifier: str, number: int) -> str:
    """The name of the first, second, … effect of a kind; of the first it is the identifier."""
    return identifier if number == 1 else f"{identifier}_{number}"


def identifier_in(name: str, known: Mapping[str, type[DescribedEffect]]) -> str:
    """The identifier of an effect that a table names; the name itself where it is no numbered one.

    Only of kinds of which there may be `several` a name is a numbered one.
    """
    match = _NUMBERED.fullmatch(name)
    if name in known or match is None:
        return name
    kind = known.get(match["identifier"])
    return name if kind is None or not kind.several else kind.identifier
