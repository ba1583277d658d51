"""All entries of the glossary as one page of Markdown, for the handbook on the live page."""

from __future__ import annotations

import re
from collections.abc import Iterator

from benchctl.app.handbook import anchor_of
from benchctl.explain.book import find, grouped
from benchctl.explain.glossary import Entry, heading


def glossary_page() -> str:
    """Return the page: the groups, and of each entry its words, its equation and links to related entries."""
    return "\n\n".join(_paragraphs())


def _paragraphs() -> Iterator[str]:
    yield "# Terms"
    yield "All effects, metrics and terms. `benchctl explain TERM` adds parameters and sources."
    for group, entries in grouped().items():
        yield f"## {_plain(heading(group))}"
        for one in entries:
            yield f"### {_plain(one.title)}"
            yield _plain(one.words)
            if one.equation:
                yield f"`{one.equation}`"
            if one.look_alikes:
                yield f"Mistaken for: {_links(one.look_alikes)}"
            if one.see:
                yield f"See: {_links(one.see)}"


def _links(names: tuple[str, ...]) -> str:
    entries: list[Entry] = [find(name)[0] for name in names]
    return ", ".join(f"[{_plain(one.title)}](#{anchor_of(one.title)})" for one in entries)


def _plain(text: str) -> str:
    """Return a text in which no character is markup."""
    return re.sub(r"([\\`*_\[\]<>|#&])", r"\\\1", text)
