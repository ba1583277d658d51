"""Values, limits, spans of time and columns of numbers as the report prints them, in the language of a catalogue."""

from __future__ import annotations

import math
from collections.abc import Sequence

from benchctl.metrology.result import Judged, Limit, Measured
from benchctl.reports import text
from benchctl.reports.acceptance.catalogue import Catalogue

_NO_BREAK = "\u00a0"
_BOUNDS = {"": "", "at least": "≥\u00a0", "at most": "≤\u00a0"}
_LIMIT_DIGITS = 10
_COLUMN_DIGITS = 6
_ROUNDING = 1e-9
"""Of a column's largest: what is smaller is zero but for the computer's rounding."""
_WIDEST_SPAN = 1e5
"""Of a column, largest over smallest: beyond, each number has its own power of ten."""


def stated(measured: Measured, words: Catalogue, *, unit: bool = True) -> str:
    """`50.012 ± 0.034 mV/(°/s)`; a bound has its sign before it; what was not measured is a dash."""
    if measured.value is None or not math.isfinite(measured.value):
        return text.NOT_KNOWN
    expanded = measured.uncertainty.expanded if measured.uncertainty else None
    printed = words.unit(measured.unit) if unit else ""
    if measured.bound and not expanded:
        bare = words.number(f"{measured.value:.4g}".replace("-", "−"))
        return _BOUNDS[measured.bound] + text.with_unit(bare, printed).replace(" ", _NO_BREAK)
    told = _BOUNDS[measured.bound] + words.number(text.with_uncertainty(measured.value, expanded, printed))
    return told.replace(" ", _NO_BREAK)


def limits(limit: Limit | None, words: Catalogue, *, unit: bool = True) -> str:
    """`49.5 to 50.5 mV/(°/s)`, `≤ 300 ppm`, or a dash."""
    if limit is None or (limit.low is None and limit.high is None):
        return text.NOT_KNOWN
    low, high = (None if end is None else exact(end, words) for end in (limit.low, limit.high))
    if low is None or high is None:
        printed = f"≤\u00a0{high}" if low is None else f"≥\u00a0{low}"
    else:
        printed = words.label("between", low=low, high=high)
    return (text.with_unit(printed, words.unit(limit.unit)) if unit else printed).replace(" ", _NO_BREAK)


def verdict_of(judged: Judged, words: Catalogue) -> str:
    """A verdict in words; without a limit that, or that there is no value either."""
    if judged.verdict is not None:
        return words.word(judged.verdict, "verdicts")
    return words.word("refused" if judged.measured.value is None else "none", "verdicts")


def exact(value: float, words: Catalogue) -> str:
    """A number that somebody wrote, with all its digits."""
    return words.number(text.raised(f"{value:.{_LIMIT_DIGITS}g}").replace("-", "−"))


def significant(value: float, words: Catalogue, digits: int = 3) -> str:
    """A number to so many digits."""
    return words.number(text.number(value, digits))


def duration(seconds: float, words: Catalogue) -> str:
    """`32 h 14 min`, `3 min 20 s`, `12 s`."""
    whole = round(seconds)
    if whole >= 3600:
        return words.label("hours_minutes", hours=str(whole // 3600), minutes=f"{whole % 3600 // 60:02d}")
    if whole >= 60:
        return words.label("minutes_seconds", minutes=str(whole // 60), seconds=f"{whole % 60:02d}")
    return words.label("seconds", seconds=str(whole))


def column(values: Sequence[float], words: Catalogue) -> list[str]:
    """A column of numbers with their decimal signs under each other, six digits of the largest at most."""
    sizes = [abs(value) for value in values if math.isfinite(value)]
    largest = max(sizes, default=0.0) or 1.0
    smallest = min((size for size in sizes if size > _ROUNDING * largest), default=1.0)
    if not 1e-3 <= largest < 1e6 or largest > _WIDEST_SPAN * smallest:
        return [significant(value, words, 4) if value else "0" for value in values]
    decimals = max(0, _COLUMN_DIGITS - 1 - math.floor(math.log10(largest)))
    printed = [f"{value + 0.0:.{decimals}f}" if math.isfinite(value) else "" for value in values]
    while decimals and all(one.endswith("0") for one in printed if one):
        printed = [one[:-1].rstrip(".") for one in printed]
        decimals -= 1
    return [words.number(one.replace("-", "−")) or text.NOT_KNOWN for one in printed]
