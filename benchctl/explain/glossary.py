"""Read `terms/*.toml`: terms of the field, and additional fields of effects and metrics."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, Literal, get_args

from benchctl.reports import text
from benchctl_instruments.physics.effects.effect import DescribedEffect

Group = Literal[
    "gyro",
    "drive",
    "chamber",
    "metrics",
    "noise",
    "calibration",
    "uncertainty",
    "diagnosis",
    "bench",
    "recordings",
    "verdicts",
    "files",
]
"""The groups of entries; their headings are in `terms/*.toml`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """An entry of the glossary.

    Attributes
    ----------
    name
        The name for commands and links: `thermal_lag`, `set point`.
    title
        The heading.
    facts
        Additional lines, by label: a unit, the procedure that measures it.
    look_alikes, see
        Names of other entries; `look_alikes` are those that the effect can be confused with.
    also
        Other spellings.
    effect
        The class of the effect, from its registry.
    """

    name: str
    title: str
    group: Group
    words: str
    equation: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    sources: tuple[str, ...] = ()
    look_alikes: tuple[str, ...] = ()
    see: tuple[str, ...] = ()
    also: tuple[str, ...] = ()
    effect: type[DescribedEffect] | None = None


_PLAIN_POWER = 5
"""Largest power of ten that is written out."""


def as_written(value: float) -> str:
    """Format a bound or a size to three digits: `0.05`, `20000`, `5 × 10⁻⁸`, `−10⁻⁴`, `∞`."""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    mantissa, _, exponent = f"{value:.3g}".partition("e")
    if exponent and 0 <= int(exponent) <= _PLAIN_POWER:
        return f"{value:.0f}".replace("-", "−")
    mantissa = mantissa.replace("-", "−")
    if not exponent:
        return mantissa
    power = text.raised(f"10^{int(exponent)}")
    if mantissa in ("1", "−1"):
        return mantissa.replace("1", power)
    return f"{mantissa}\u00a0×\u00a0{power}"


@cache
def tables() -> Mapping[str, Any]:
    """Read all files; tables with the same name are merged."""
    found: dict[str, Any] = {}
    for file in files("benchctl.explain").joinpath("terms").iterdir():
        for name, table in tomllib.loads(file.read_text(encoding="utf-8")).items():
            found[name] = found.get(name, {}) | table
    return found


def heading(group: Group) -> str:
    """Return the heading of a group."""
    return str(tables()["groups"][group])


def kind(group: Group) -> str:
    """Return the kind of a single entry of a group."""
    return str(tables()["kinds"][group])


def extra(table: str, name: str) -> Mapping[str, Any]:
    """Return the additional fields of an effect or a metric; empty if there are none."""
    found: Mapping[str, Any] = tables()[table].get(name, {})
    return found


def shared(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of an entry that every table may contain."""
    return {name: tuple(table.get(name, ())) for name in ("sources", "see", "also")}


def term_entries() -> Iterator[Entry]:
    """Yield the terms, by group and in the order of their file."""
    for group in get_args(Group):
        for name, table in tables()["terms"].get(group, {}).items():
            yield Entry(
                name=name,
                title=name,
                group=group,
                words=table["words"],
                equation=table.get("equation", ""),
                **shared(table),
            )
