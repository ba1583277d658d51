"""The acceptance report as a PDF: Typst sets the pages of `acceptance.typ`, with the same contents as the page.

The fonts are DejaVu Sans, which matplotlib contains: they include Cyrillic and the letters of formulas.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib as mpl
import typst
from matplotlib.ft2font import FT2Font

from benchctl.limits import cut
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl.reports.acceptance.document import Report

_FONTS = Path(mpl.get_data_path(), "fonts", "ttf")
_LONGEST = 3000
"""Maximum number of characters of user text."""


def pdf(report: Report) -> bytes:
    """Return the document; the same report gives the same bytes."""
    started = {name: getattr(report.started, name) for name in ("year", "month", "day", "hour", "minute", "second")}
    told = asdict(report) | {"started": started, "numbers": dict(report.numbers)}
    document = json.dumps({"r": _plain(told), "words": catalogue(report.language).tables["labels"]})
    template = files("benchctl.reports.acceptance").joinpath("acceptance.typ").read_bytes()
    return typst.compile(
        template,
        output=None,
        format="pdf",
        font_paths=typst.Fonts(include_system_fonts=False, include_embedded_fonts=False, font_paths=[str(_FONTS)]),
        sys_inputs={"report": document},
        timestamp=report.started,
    )


def _plain(value: Any) -> Any:
    """Return plain data for JSON: bytes as numbers, texts with characters that the font has."""
    match value:
        case str():
            return "".join(_letter(one) for one in cut(value, _LONGEST))
        case bytes():
            return list(value)
        case dict():
            return {key: _plain(part) for key, part in value.items()}
        case list() | tuple():
            return [_plain(part) for part in value]
    return value


def _letter(one: str) -> str:
    """Return the character, U+FFFD if the font lacks it, a space for a line break."""
    if one.isspace():
        return one if one in "\u00a0\u202f" else " "
    return one if one.isprintable() and ord(one) in _letters() else "\ufffd"


@cache
def _letters() -> frozenset[int]:
    return frozenset(FT2Font(str(_FONTS / "DejaVuSans.ttf")).get_charmap())
