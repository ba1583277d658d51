"""An explanation as plain data, for programs and for the live page."""

from __future__ import annotations

from typing import Any

from benchctl.explain.book import find
from benchctl.explain.effects import parameters, symbols
from benchctl.explain.glossary import Entry, as_written, kind


def explained(term: str) -> dict[str, Any]:
    """What a term means: name, title, kind, words, equation, parameters, facts, sources and names of other entries.

    Where it has several meanings, `also_means` has the others, each a dictionary of the same keys.

    Raises
    ------
    UsageError
        Where there is no such term; names the nearest.
    """
    first, *others = find(term)
    return {**as_values(first), "also_means": [as_values(one) for one in others]}


def as_values(entry: Entry) -> dict[str, Any]:
    """One entry as plain data."""
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
        "picture": bool(entry.drawing),
    }


def usual(entry: Entry) -> dict[str, tuple[float, float]]:
    """Usual sizes of an effect's parameters, of those of the gyro for which they are known."""
    if entry.effect is None or entry.group != "gyro":
        return {}
    from benchctl.explain.sizes import usual_sizes  # what draws trials takes half a second to import

    return usual_sizes(entry.name)
