"""All entries, and which of them a word means, however it is spelt."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping
from functools import cache
from typing import get_args

from benchctl.closeness import meant
from benchctl.explain.effects import effect_entries
from benchctl.explain.glossary import Entry, Group, extra, shared, term_entries
from benchctl.limits import cut
from benchctl.metrology.names import PROCEDURES, UNITS
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl_instruments.errors import UsageError

_BRITISH = (("z", "s"), ("fiber", "fibre"), ("center", "centre"), ("aging", "ageing"))
_SYMBOL = 2
"""Of a spelling this short the case matters: K and k, U and u, S and s."""
_LONGEST = 80
"""Letters of a term: in longer ones no near name is looked for."""


@cache
def entries() -> tuple[Entry, ...]:
    """Every entry: effects, metrics, terms, in the order of the groups."""
    found = (*effect_entries(), *metric_entries(), *term_entries())
    return tuple(sorted(found, key=lambda one: get_args(Group).index(one.group)))


def grouped() -> Mapping[Group, tuple[Entry, ...]]:
    """Every entry by its group."""
    return {group: tuple(one for one in entries() if one.group == group) for group in get_args(Group)}


def find(term: str) -> tuple[Entry, ...]:
    """The entries that a term names, one or, where it has several meanings, all of them.

    Case, blanks, underscores, hyphens, a plural and American spelling do not matter; names go before further spellings.

    Raises
    ------
    UsageError
        Where there is none; names the nearest.
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
    """Entries by the keys of their names, and by those of every spelling."""
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
    """What is left where nothing but letters and digits counts."""
    key = re.sub(r"[\W_]+", "", unicodedata.normalize("NFKC", spelling).casefold())
    for american, british in _BRITISH:
        key = key.replace(american, british)
    return key.removesuffix("s") if len(key) > _SYMBOL else key


def metric_entries() -> Iterator[Entry]:
    """Every result, in the order of the report."""
    words = catalogue("en")
    for name, unit in UNITS.items():
        test, more = words.test(name), extra("metrics", name)
        facts = {"Unit": words.unit(unit), "Computed": more.get("computed", ""), "Others mean": more.get("others", "")}
        if name in PROCEDURES:
            facts["Measured by"] = f"benchctl run {PROCEDURES[name]}; benchctl run acceptance has it too"
        facts["Limit"] = f"[limits.{name}] in limits.toml"
        yield Entry(
            name=name,
            title=test.name,
            group=more.get("group", "metrics"),
            words=test.definition,
            equation=test.formula,
            facts={label: value for label, value in facts.items() if value},
            drawing=more.get("picture", ""),
            **shared(more),
        )
