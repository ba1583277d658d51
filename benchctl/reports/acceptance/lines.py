"""The acceptance for a terminal: a line a test, then the verdict."""

from __future__ import annotations

import unicodedata

from benchctl.limits import cut
from benchctl.metrology.result import Acceptance
from benchctl.reports.acceptance.build import tally
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl.reports.acceptance.values import limits, stated, verdict_of

_WIDEST = 120
_GAP = 2


def lines(acceptance: Acceptance, language: str = "en") -> str:
    """Name, value ± U, limit and verdict of each test, aligned; no line is wider than 120 characters, but the last."""
    words = catalogue(language)
    names = [_plain(words.test(one.measured.name).name) for one in acceptance.judged]
    columns = [
        [_plain(stated(one.measured, words)) for one in acceptance.judged],
        [_plain(limits(one.limit, words, unit=False)) for one in acceptance.judged],
        [verdict_of(one, words) for one in acceptance.judged],
    ]
    widths = [max(map(len, column), default=0) for column in columns]
    room = _WIDEST - sum(widths) - _GAP * len(widths)
    names = [cut(name, room) for name in names]
    widths.insert(0, max(map(len, names), default=0))
    told = [
        "".join(cell.ljust(width + _GAP) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in zip(names, *columns, strict=True)
    ]
    verdict = words.word(f"unit_{acceptance.verdict}", "verdicts")
    return "\n".join([*told, f"{verdict}. {tally(acceptance, words)}"])


def _plain(cell: str) -> str:
    """One line of printable characters, each of one column."""
    return "".join(" " if one.isspace() else one for one in cell if not unicodedata.category(one).startswith("C"))
