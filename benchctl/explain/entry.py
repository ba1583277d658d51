"""One thing that can be explained, whatever kind of thing it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

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
"""Where an entry stands in the list; `terms/*.toml` has the headings."""

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
