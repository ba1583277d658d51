"""The texts of the acceptance report in each language, from `en.toml` and `ru.toml`, which have the same keys.

The tests name their messages by keys (`benchctl.metrology.result`); this module converts keys to sentences. A key that
is missing from a catalogue is printed with spaces for its underscores.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

from benchctl.metrology.result import Judged, Limit, Measured, Message
from benchctl.reports import text
from benchctl_instruments.errors import UsageError

Language = Literal["en", "ru"]
LANGUAGES: tuple[Language, ...] = ("en", "ru")

_DIGITS = 3
_POINT = re.compile(r"(?<=\d)\.(?=\d)")
_NUMBER = re.compile(r"-?\d+(\.\d+)?")
_PLACEHOLDER = re.compile(r"\\\{(\w+)\\\}")


@dataclass(frozen=True, slots=True, kw_only=True)
class TestWords:
    """A test's name, the definition that it follows, and the formula of that definition."""

    name: str
    definition: str
    formula: str


@dataclass(frozen=True, slots=True)
class Catalogue:
    """The texts of one language; `tables` is the content of its file."""

    language: Language
    tables: Mapping[str, Any]

    def said(self, sentence: Message) -> str:
        """Return the sentence of a message with its numbers."""
        values = {name: self._filled(name, value) for name, value in sentence.values.items()}
        return str(self.tables["said"][sentence.key].format_map(values))

    def test(self, name: str) -> TestWords:
        """Return the texts of a test by the name of its result."""
        texts = self.tables["tests"].get(name, {})
        return TestWords(
            name=texts.get("name", _spelt(name)),
            definition=texts.get("definition", ""),
            formula=texts.get("formula", ""),
        )

    def label(self, key: str, **values: str) -> str:
        """Return a heading or another fixed text of the report."""
        return str(self.tables["labels"][key].format_map(values))

    def word(self, key: str, table: str = "words") -> str:
        """Return the word for a key of a table: a column, an axis, a role, a kind of step, a source."""
        return str(self.tables[table].get(key, _spelt(key)))

    def phrase(self, told: str) -> str:
        """Translate an English phrase with numbers from a measurement, if the catalogue contains it."""
        for key, english in catalogue("en").tables["phrases"].items():
            pattern = _PLACEHOLDER.sub(r"(?P<\1>.+)", re.escape(english))
            if found := re.fullmatch(pattern, told):
                values = {name: self._told(value) for name, value in found.groupdict().items()}
                return str(self.tables["phrases"][key].format_map(values))
        return told

    def stage(self, told: str) -> str:
        """Return the name of a test stage, given in any of the languages; other text is returned unchanged."""
        for language in LANGUAGES:
            for key, word in catalogue(language).tables["stages"].items():
                if told.strip().casefold() in (key, _spelt(key), word.casefold()):
                    return str(self.tables["stages"][key])
        return told

    def unit(self, unit: str) -> str:
        """Return a printed unit: `deg/sqrt(h)` becomes °/√h, or °/√ч; `1` nothing."""
        if unit == "1":
            return ""
        rooted = re.sub(r"sqrt\((\w+)\)", r"√\1", unit)
        return re.sub(r"[A-Za-z]+", lambda found: self.word(found[0], "units"), rooted)

    def number(self, formatted: str) -> str:
        """Replace the decimal point of a number formatted by `benchctl.reports.text` by this language's sign."""
        return _POINT.sub(self.tables["decimal"], formatted)

    def _told(self, value: str) -> str:
        """Return the text for a phrase's placeholder: a number, a phrase, or the value unchanged."""
        return self.number(value) if _NUMBER.fullmatch(value) else self.phrase(value)

    def _filled(self, name: str, value: float | str) -> str:
        if isinstance(value, str):
            tables = {"role": "roles", "status": "statuses", "source": "sources"}
            if name == "unit":
                return self.unit(value)
            return self.word(value, tables[name]) if name in tables else self.phrase(value)
        return self.number(short(value))


def short(value: float) -> str:
    """Format a number within a sentence: three digits, without trailing zeros after the decimal sign."""
    if not 1e-3 <= abs(value) < 1e6:
        return text.number(value, _DIGITS) if value else "0"
    return text.plain(value, "", max(0, _DIGITS - 1 - math.floor(math.log10(abs(value)))))


@cache
def catalogue(language: str) -> Catalogue:
    """Load the texts of one language; raises `UsageError` for an unsupported language."""
    if language not in LANGUAGES:
        raise UsageError(f"--lang {language}: the report is written in {' or '.join(LANGUAGES)}; name one of them")
    file = files("benchctl.reports.acceptance").joinpath(f"{language}.toml")
    return Catalogue(language, tomllib.loads(file.read_text(encoding="utf-8")))


def _spelt(key: str) -> str:
    return key.replace("_", " ")


_NO_BREAK = "\u00a0"
_BOUNDS = {"": "", "at least": "≥\u00a0", "at most": "≤\u00a0"}
_LIMIT_DIGITS = 10
_COLUMN_DIGITS = 6
_ROUNDING = 1e-9
"""Relative to the largest value of a column: smaller values are rounding errors, that is, zero."""
_WIDEST_SPAN = 1e5
"""Largest over smallest value of a column; above this ratio each number has its own power of ten."""


def stated(measured: Measured, words: Catalogue, *, unit: bool = True) -> str:
    """Format as `50.012 ± 0.034 mV/(°/s)`; a bound is preceded by its sign; a missing value is a dash."""
    if measured.value is None or not math.isfinite(measured.value):
        return text.NOT_KNOWN
    expanded = measured.uncertainty.expanded if measured.uncertainty else None
    printed = words.unit(measured.unit) if unit else ""
    if measured.bound and not expanded:
        bare = words.number(f"{measured.value:.4g}".replace("-", "−"))
        return _BOUNDS[measured.bound] + text.with_unit(bare, printed).replace(" ", _NO_BREAK)
    formatted = _BOUNDS[measured.bound] + words.number(text.with_uncertainty(measured.value, expanded, printed))
    return formatted.replace(" ", _NO_BREAK)


def limits(limit: Limit | None, words: Catalogue, *, unit: bool = True) -> str:
    """Format as `49.5 to 50.5 mV/(°/s)`, `≤ 300 ppm`, or a dash."""
    if limit is None or (limit.low is None and limit.high is None):
        return text.NOT_KNOWN
    low, high = (None if end is None else exact(end, words) for end in (limit.low, limit.high))
    if low is None or high is None:
        printed = f"≤\u00a0{high}" if low is None else f"≥\u00a0{low}"
    else:
        printed = words.label("between", low=low, high=high)
    return (text.with_unit(printed, words.unit(limit.unit)) if unit else printed).replace(" ", _NO_BREAK)


def verdict_of(judged: Judged, words: Catalogue) -> str:
    """Return the verdict in words; without a limit, whether the value is only stated or missing."""
    if judged.verdict is not None:
        return words.word(judged.verdict, "verdicts")
    return words.word("refused" if judged.measured.value is None else "none", "verdicts")


def exact(value: float, words: Catalogue) -> str:
    """Format a number that was entered by a person, with all its digits."""
    return words.number(text.raised(f"{value:.{_LIMIT_DIGITS}g}").replace("-", "−"))


def significant(value: float, words: Catalogue, digits: int = 3) -> str:
    """Format a number to `digits` significant digits."""
    return words.number(text.number(value, digits))


def duration(seconds: float, words: Catalogue) -> str:
    """Format a duration: `32 h 14 min`, `3 min 20 s`, `12 s`."""
    rounded = round(seconds)
    if rounded >= 3600:
        return words.label("hours_minutes", hours=str(rounded // 3600), minutes=f"{rounded % 3600 // 60:02d}")
    if rounded >= 60:
        return words.label("minutes_seconds", minutes=str(rounded // 60), seconds=f"{rounded % 60:02d}")
    return words.label("seconds", seconds=str(rounded))


def column(values: Sequence[float], words: Catalogue) -> list[str]:
    """Format a column of numbers with aligned decimal signs, with at most six digits of the largest."""
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
