"""All entries of the glossary, the search for an entry by any spelling, and an entry as plain data.

Effects are described by their registries, also those of third parties.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args

from benchctl.closeness import meant
from benchctl.explain.glossary import Entry, Group, as_written, extra, kind, shared, tables, term_entries
from benchctl.limits import cut
from benchctl.metrology.names import PROCEDURES, UNITS
from benchctl.reports import vocabulary
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl.reports.vocabulary import advice_for
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter
from benchctl_instruments.physics.effects.numbered import numbered
from benchctl_instruments.physics.effects.registry import effects

_LETTER = "[A-Za-zΑ-ω0-9_]"
"""Characters of a name in an equation; superscript powers, as in ω², are not part of it."""
_ALL = "diagnostic"
"""The procedure that excites every effect of the gyro that a bench can excite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterWords:
    """The description of a parameter; `usual` is empty if no usual size is known."""

    name: str
    meaning: str
    unit: str
    role: str
    low: float
    high: float
    gone: float | None
    usual: tuple[float, float] | None = None


def effect_entries() -> Iterator[Entry]:
    """Yield all effects of the gyro, of the drive and of the chamber."""
    yield from (_entry("gyro", one) for one in effects().values())
    yield from (_entry("drive", one) for one in drive_effects().values())
    yield from (_entry("chamber", one) for one in chamber_effects().values())


def symbols(entry: Entry) -> dict[str, str]:
    """Return the symbols in an effect's equation with their meanings."""
    if entry.effect is None:
        return {}
    known = {**tables()["symbols"].get(entry.group, {}), **extra("effects", entry.name).get("symbols", {})}
    return {letter: meaning for letter, meaning in known.items() if _occurs_in(letter, entry.equation)}


def parameters(entry: Entry, usual: Mapping[str, tuple[float, float]]) -> tuple[ParameterWords, ...]:
    """Return the parameters of an effect, in the order of its fields; empty for other entries."""
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
        effect=kind,
        **shared(more),
    )


def _facts(group: Group, kind: type[DescribedEffect]) -> Iterator[tuple[str, str]]:
    stage = getattr(kind, "stage", "")
    if stage:
        yield "Acts on", tables()["stages"][group].get(stage, stage.replace("_", " "))
    yield "Depends on", f"{vocabulary.coordinate(kind.coordinate)} ({kind.coordinate})"
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


_BRITISH = (("z", "s"), ("fiber", "fibre"), ("center", "centre"), ("aging", "ageing"))
_SYMBOL = 2
"""Up to this length a spelling is case-sensitive: K and k, U and u, S and s."""
_LONGEST = 80
"""Maximum length of a term for which similar names are suggested."""


@cache
def entries() -> tuple[Entry, ...]:
    """Return all entries: effects, metrics and terms, in the order of the groups."""
    found = (*effect_entries(), *metric_entries(), *term_entries())
    return tuple(sorted(found, key=lambda one: get_args(Group).index(one.group)))


def grouped() -> Mapping[Group, tuple[Entry, ...]]:
    """Return all entries by group."""
    return {group: tuple(one for one in entries() if one.group == group) for group in get_args(Group)}


def find(term: str) -> tuple[Entry, ...]:
    """Return the entries that a term names: one, or all if it has several meanings.

    Case, blanks, underscores, hyphens, plural and American spelling are ignored; names have priority over other
    spellings.

    Raises
    ------
    UsageError
        If there is none; the message suggests the nearest.
    """
    given = unicodedata.normalize("NFKC", " ".join(term.split()))
    if len(given) <= _SYMBOL:
        exact = tuple(one for one in entries() if given in _spellings(one))
        if exact:
            return exact
    key = _key(given)
    by_name, by_spelling = _index()
    found = by_name.get(key) or by_spelling.get(key)
    if found:
        return found
    known = [spelling for one in entries() for spelling in _spellings(one)] if len(given) <= _LONGEST else []
    hint = meant(given, known, "benchctl explain lists them")
    raise UsageError(f"explain {cut(repr(term), _LONGEST)}: there is no such term: {hint}")


@cache
def _index() -> tuple[Mapping[str, tuple[Entry, ...]], Mapping[str, tuple[Entry, ...]]]:
    """Return the entries by the keys of their names, and by those of all spellings."""
    by_name: dict[str, tuple[Entry, ...]] = {}
    by_spelling: dict[str, tuple[Entry, ...]] = {}
    for one in entries():
        for index, spelt in ((by_name, _names(one)), (by_spelling, _spellings(one))):
            for key in dict.fromkeys(filter(None, map(_key, spelt))):
                index[key] = (*index.get(key, ()), one)
    return by_name, by_spelling


def _names(entry: Entry) -> tuple[str, ...]:
    return entry.name, entry.title


def _spellings(entry: Entry) -> tuple[str, ...]:
    return (*_names(entry), *(unicodedata.normalize("NFKC", one) for one in entry.also))


def _key(spelling: str) -> str:
    """Return a spelling reduced to lower-case letters and digits, in British spelling without a plural s."""
    key = re.sub(r"[\W_]+", "", unicodedata.normalize("NFKC", spelling).casefold())
    for american, british in _BRITISH:
        key = key.replace(american, british)
    return key.removesuffix("s") if len(key) > _SYMBOL else key


def metric_entries() -> Iterator[Entry]:
    """Yield all metrics, in the order of the report."""
    words = catalogue("en")
    for name, unit in UNITS.items():
        test, more = words.test(name), extra("metrics", name)
        facts = {"Unit": words.unit(unit), "Computed": more.get("computed", ""), "Others mean": more.get("others", "")}
        facts["Measured by"] = f"benchctl run {PROCEDURES[name]}; benchctl run acceptance has it too"
        facts["Limit"] = f"[limits.{name}] in limits.toml"
        yield Entry(
            name=name,
            title=test.name,
            group=more.get("group", "metrics"),
            words=test.definition,
            equation=test.formula,
            facts={label: value for label, value in facts.items() if value},
            **shared(more),
        )


def explained(term: str) -> dict[str, Any]:
    """Return the meaning of a term: name, title, kind, words, equation, parameters, facts, sources and related entries.

    If it has several meanings, `also_means` contains the others as dictionaries with the same keys.

    Raises
    ------
    UsageError
        If there is no such term; the message suggests the nearest.
    """
    first, *others = find(term)
    return {**as_values(first), "also_means": [as_values(one) for one in others]}


def as_values(entry: Entry) -> dict[str, Any]:
    """Return one entry as plain data."""
    return {
        "name": entry.name,
        "title": entry.title,
        "group": entry.group,
        "kind": kind(entry.group),
        "words": entry.words,
        "equation": entry.equation,
        "symbols": symbols(entry),
        "parameters": [
            {
                "name": one.name,
                "meaning": one.meaning,
                "unit": one.unit,
                "role": one.role,
                "low": one.low,
                "high": one.high,
                "no_effect_at": None if one.gone is None else as_written(one.gone),
                "usual": list(one.usual) if one.usual else None,
            }
            for one in parameters(entry, usual(entry))
        ],
        "facts": [{"label": label, "says": value} for label, value in entry.facts.items()],
        "look_alikes": list(entry.look_alikes),
        "sources": list(entry.sources),
        "see": list(entry.see),
        "also_called": list(entry.also),
    }


def usual(entry: Entry) -> dict[str, tuple[float, float]]:
    """Return the usual sizes of an effect's parameters, if it is one of the gyro and they are known."""
    if entry.effect is None or entry.group != "gyro":
        return {}
    from benchctl.explain.sizes import usual_sizes  # the module that draws trials takes half a second to import

    return usual_sizes(entry.name)
