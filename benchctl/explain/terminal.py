"""Explanations formatted for a terminal: one entry, or the list of all."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping

from benchctl.explain.book import ParameterWords, parameters, symbols, usual
from benchctl.explain.glossary import Entry, Group, as_written, heading, kind
from benchctl.reports import text

NARROWEST, WIDEST = 64, 100
_LABELS = 16
"""Width of the column of labels."""
_CLAUSE = re.compile(r"[.:;](?=\s)|[.]$")
_USUAL = "usual: as `benchctl prove` draws it, on a gyro of 10 V at 200 °/s with a noise of 1.5 mV"


def page(entry: Entry, columns: int) -> str:
    """Return an entry, wrapped to `columns`."""
    return "\n".join(_lines(entry, _width(columns)))


def listing(groups: Mapping[Group, tuple[Entry, ...]], columns: int) -> str:
    """Return a line for each entry, by groups."""
    return "\n".join(_listed(groups, _width(columns)))


def _width(columns: int) -> int:
    return max(NARROWEST, min(columns, WIDEST))


def _lines(entry: Entry, width: int) -> Iterator[str]:
    yield f"{entry.title}{kind(entry.group):>{max(width - len(entry.title), 0)}}"
    yield ""
    yield from _wrapped(entry.words, width, "  ")
    yield ""
    if entry.equation:
        yield from _labelled("Equation", entry.equation, width)
        yield from _symbol_lines(symbols(entry), width)
    yield from _parameter_lines(parameters(entry, usual(entry)), width)
    for label, value in entry.facts.items():
        yield from _labelled(label, value, width)
    for label, listed in (
        ("Mistaken for", ", ".join(entry.look_alikes)),
        ("Sources", "; ".join(entry.sources)),
        ("Also called", ", ".join(entry.also)),
        ("See", ", ".join(entry.see)),
    ):
        if listed:
            yield from _labelled(label, listed, width)


def _symbol_lines(letters: Mapping[str, str], width: int) -> Iterator[str]:
    if letters:
        yield from _labelled("", "; ".join(f"{letter}: {meaning}" for letter, meaning in letters.items()), width)


def _parameter_lines(described: tuple[ParameterWords, ...], width: int) -> Iterator[str]:
    for place, one in enumerate(described):
        yield from _labelled("" if place else "Parameters", f"{one.name}: {one.meaning}{_sizes(one)}", width)
    if any(one.usual for one in described):
        yield from _labelled("", f"({_USUAL})", width)


def _sizes(one: ParameterWords) -> str:
    """Return unit, bounds and usual size of a parameter."""
    parts = [f"{as_written(one.low)} to {text.with_unit(as_written(one.high), one.unit)}"]
    if one.usual is not None:
        either = "±" if one.low < 0.0 else ""
        low, high = one.usual
        parts.append(f"usual {either}{text.with_unit(_span(low, high), one.unit)}")
    if one.gone is not None:
        parts.append(f"none at {as_written(one.gone)}")
    return f"; {', '.join(parts)}"


def _span(low: float, high: float) -> str:
    return as_written(low) if low == high else f"{as_written(low)} to {as_written(high)}"


def _labelled(label: str, value: str, width: int) -> Iterator[str]:
    """Yield a label and its value in a column."""
    first = f"  {label:<{_LABELS}}"
    lines = _wrapped(value, width, " " * len(first))
    lines[0] = first + lines[0][len(first) :]
    yield from lines


def _wrapped(value: str, width: int, indent: str) -> list[str]:
    return textwrap.wrap(
        value, width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
    )


def _listed(groups: Mapping[Group, tuple[Entry, ...]], width: int) -> Iterator[str]:
    for group, members in groups.items():
        if not members:
            continue
        yield f"{heading(group)}:"
        column = max(len(one.name) for one in members) + 2
        for one in members:
            yield f"  {one.name:<{column}}{_short(_gist(one), width - column - 2)}"
        yield ""
    yield "benchctl explain NAME explains one."


def _gist(entry: Entry) -> str:
    """Return the text after a name in the list: the title of a metric, else the first clause of the words."""
    if entry.group in ("metrics", "noise"):
        return text.with_unit(entry.title + ",", entry.facts["Unit"])
    return _CLAUSE.split(entry.words, maxsplit=1)[0]


def _short(clause: str, room: int) -> str:
    """Shorten a clause to the available space, at a comma if possible."""
    while len(clause) > room and ", " in clause:
        clause = clause.rpartition(", ")[0]
    return textwrap.shorten(clause, room, placeholder=" …")
