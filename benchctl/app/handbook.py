"""The pages of the handbook, as Markdown."""

from __future__ import annotations

import re
from importlib.resources import files


def topics() -> dict[str, str]:
    """Return the pages of the handbook, Markdown, by their topic."""
    pages = files("benchctl").joinpath("handbook").iterdir()
    found = {page.name.removesuffix(".md"): page.read_text(encoding="utf-8") for page in pages}
    return dict(sorted(found.items()))


def title_of(page: str) -> str:
    """Return the title of a page: its first line."""
    return page.partition("\n")[0].removeprefix("# ")


def anchor_of(heading: str) -> str:
    """Return the name that links use for a heading, as GitHub forms it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
