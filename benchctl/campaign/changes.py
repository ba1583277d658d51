"""What changed between two tables, in words that an error or a report can repeat."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from benchctl.limits import cut

_LONGEST_WORD = 200


def flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables, and lists of tables, as one table by dotted names."""
    found: dict[str, Any] = {}
    for name, value in tables.items():
        if isinstance(value, list) and any(isinstance(item, dict) for item in value):
            value = {str(place): item for place, item in enumerate(value)}
        if isinstance(value, dict):
            found |= flat(value, f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def changes(prefix: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """A sentence for each name whose value is another, or is in one table only."""
    for name in sorted(before.keys() | now.keys()):
        if before.get(name) != now.get(name):
            yield changed(f"{prefix}{name}", before.get(name), now.get(name))


def changed(what: str, before: object, now: object) -> str:
    """`what was 5, is 6`; None is what is not there, and no text is empty."""
    return f"{what} was {_word(before)}, is {_word(now)}"


def _word(value: object) -> str:
    if value is None:
        return "not there"
    return "empty" if value == "" else cut(str(value), _LONGEST_WORD)
