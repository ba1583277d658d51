"""Effects as their registries describe them; one of a third party is explained like one of ours."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from benchctl.explain.glossary import Entry, Group, extra, shared, tables
from benchctl.reports import vocabulary
from benchctl.reports.advice import advice_for
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter
from benchctl_instruments.physics.effects.numbered import numbered
from benchctl_instruments.physics.effects.registry import effects

_LETTER = "[A-Za-zΑ-ω0-9_]"
"""What a name in an equation is made of; powers, ω², do not belong to it."""
_ALL = "diagnostic"
"""The procedure that brings out every effect of the gyro that a bench can bring out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterWords:
    """A parameter in words; `usual` is empty where nothing is known of what is usual."""

    name: str
    meaning: str
    unit: str
    role: str
    low: float
    high: float
    gone: float | None
    usual: tuple[float, float] | None = None


def effect_entries() -> Iterator[Entry]:
    """Every effect of the gyro, of the drive and of the chamber."""
    yield from (_entry("gyro", one) for one in effects().values())
    yield from (_entry("drive", one) for one in drive_effects().values())
    yield from (_entry("chamber", one) for one in chamber_effects().values())


def symbols(entry: Entry) -> dict[str, str]:
    """The letters of an effect's equation and what they stand for."""
    if entry.effect is None:
        return {}
    known = {**tables()["symbols"].get(entry.group, {}), **extra("effects", entry.name).get("symbols", {})}
    return {letter: meaning for letter, meaning in known.items() if _occurs_in(letter, entry.equation)}


def parameters(entry: Entry, usual: Mapping[str, tuple[float, float]]) -> tuple[ParameterWords, ...]:
    """The parameters of an effect, in the order of its fields; none of what is no effect."""
    if entry.effect is None:
        return ()
    described: Mapping[str, Parameter] = entry.effect.parameters
    return tuple(
        ParameterWords(
            name=name,
            meaning=one.meaning,
            unit=vocabulary.unit(one.unit),
            role=one.role,
            low=one.low,
            high=one.high,
            gone=one.zero,
            usual=usual.get(name),
        )
        for name, one in described.items()
    )


def _entry(group: Group, kind: type[DescribedEffect]) -> Entry:
    more = extra("effects", kind.identifier)
    return Entry(
        name=kind.identifier,
        title=kind.identifier.replace("_", " "),
        group=group,
        words=kind.words,
        equation=kind.equation,
        facts=dict(_facts(group, kind)),
        look_alikes=kind.look_alikes,
        drawing=f"effect:{kind.identifier}",
        effect=kind,
        **shared(more),
    )


def _facts(group: Group, kind: type[DescribedEffect]) -> Iterator[tuple[str, str]]:
    stage = getattr(kind, "stage", "")
    if stage:
        yield "Acts on", tables()["stages"][group].get(stage, stage.replace("_", " "))
    yield "Seen along", f"{vocabulary.coordinate(kind.coordinate)} ({kind.coordinate})"
    yield "Brought out by", kind.excited_by
    if group == "gyro":
        own = tables()["procedures"].get(kind.coordinate, ())
        yield "Shown by", "; ".join(f"benchctl run {name}" for name in (*own, _ALL))
        yield "Found by", "benchctl diagnose RECORDING"
    else:
        yield "Found by", f"benchctl diagnose RECORDING --part {group}"
    if (advice := advice_for(kind.identifier)) is not None:
        yield "Calibration", advice.calibration
        yield "At the bench", advice.bench
    table = "effects" if group == "gyro" else f"parts.{group}.effects"
    second = f"; a further one is [{table}.{numbered(kind.identifier, 2)}]" if kind.several else ""
    yield "In a model file", f"[{table}.{kind.identifier}]{second}"


def _occurs_in(letter: str, equation: str) -> bool:
    return re.search(rf"(?<!{_LETTER}){re.escape(letter)}(?!{_LETTER})", equation) is not None
