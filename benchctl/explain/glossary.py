"""Read `terms/*.toml`: terms of the field, and further fields of effects and metrics."""

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
"""The groups of the list; `terms/*.toml` has the headings."""

PART_OF_BENCH: tuple[Group, ...] = ("gyro", "drive", "chamber")
"""Groups of effects: each a part of the bench."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """An entry of the glossary.

    Attributes
    ----------
    name
        As it is typed and linked to: `thermal_lag`, `set point`.
    title
        As a heading.
    facts
        Further lines, by their label: a unit, which procedure measures it.
    look_alikes, see
        Names of other entries; the first are those with which an effect can be confused.
    also
        Further spellings.
    drawing
        Which picture it has, see `benchctl.explain.pictures`; empty where it has none.
    effect
        The effect that it describes, from its registry.
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
    drawing: str = ""
    effect: type[DescribedEffect] | None = None


_PLAIN_POWER = 5
"""Powers of ten up to which a number is written out."""


def as_written(value: float) -> str:
    """A bound or a size to three digits: `0.05`, `20000`, `5 × 10⁻⁸`, `−10⁻⁴`, `∞`."""
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
    """All files as one; a table that several of them have is shared out over them."""
    found: dict[str, Any] = {}
    for file in files("benchctl.explain").joinpath("terms").iterdir():
        for name, table in tomllib.loads(file.read_text(encoding="utf-8")).items():
            found[name] = found.get(name, {}) | table
    return found


def heading(group: Group) -> str:
    """What a group is called in the list."""
    return str(tables()["groups"][group])


def kind(group: Group) -> str:
    """What one entry of a group is."""
    return str(tables()["kinds"][group])


def extra(table: str, name: str) -> Mapping[str, Any]:
    """Return the further fields of an effect or a metric; empty where there are none."""
    found: Mapping[str, Any] = tables()[table].get(name, {})
    return found


def shared(table: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of an entry that every table may state."""
    return {name: tuple(table.get(name, ())) for name in ("sources", "see", "also")}


def term_entries() -> Iterator[Entry]:
    """The terms, in the order of their file within that of the groups."""
    for group in get_args(Group):
        for name, table in tables()["terms"].get(group, {}).items():
            yield Entry(
                name=name,
                title=name,
                group=group,
                words=table["words"],
                equation=table.get("equation", ""),
                drawing=table.get("picture", ""),
                **shared(table),
            )
