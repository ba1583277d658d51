"""The words of the acceptance report in each of its languages, from `en.toml` and `ru.toml`, which have the same keys.

Whoever measures names what is said by keys (`benchctl.metrology.result`); here the keys become sentences. A key that a
catalogue lacks is shown as it is, its underscores as spaces: a report with one plain word is better than none.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

from benchctl.metrology.result import Message
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
    """A test in words: what it is called, which definition of it is meant, and the formula of that."""

    name: str
    definition: str
    formula: str


@dataclass(frozen=True, slots=True)
class Catalogue:
    """One language; `tables` is its file."""

    language: Language
    tables: Mapping[str, Any]

    def said(self, sentence: Message) -> str:
        """A sentence with its numbers."""
        told = {name: self._filled(name, value) for name, value in sentence.values.items()}
        return str(self.tables["said"][sentence.key].format_map(told))

    def test(self, name: str) -> TestWords:
        """A test by the name of its result."""
        told = self.tables["tests"].get(name, {})
        return TestWords(
            name=told.get("name", _spelt(name)),
            definition=told.get("definition", ""),
            formula=told.get("formula", ""),
        )

    def label(self, key: str, **values: str) -> str:
        """A heading or another fixed part of the report."""
        return str(self.tables["labels"][key].format_map(values))

    def word(self, key: str, table: str = "words") -> str:
        """What a table of the catalogue calls a key: a column, an axis, a role, a kind of step, a source."""
        return str(self.tables[table].get(key, _spelt(key)))

    def phrase(self, told: str) -> str:
        """A phrase that measuring brings in English, numbers in it, in this language where the catalogue has it."""
        for key, english in catalogue("en").tables["phrases"].items():
            pattern = _PLACEHOLDER.sub(r"(?P<\1>.+)", re.escape(english))
            if found := re.fullmatch(pattern, told):
                values = {name: self._told(value) for name, value in found.groupdict().items()}
                return str(self.tables["phrases"][key].format_map(values))
        return told

    def stage(self, told: str) -> str:
        """A stage of testing, which may be stated in any of the languages, or in words of the customer's own."""
        for language in LANGUAGES:
            for key, word in catalogue(language).tables["stages"].items():
                if told.strip().casefold() in (key, _spelt(key), word.casefold()):
                    return str(self.tables["stages"][key])
        return told

    def unit(self, unit: str) -> str:
        """A unit as the field prints it: `deg/sqrt(h)` becomes °/√h, or °/√ч; `1` nothing."""
        if unit == "1":
            return ""
        rooted = re.sub(r"sqrt\((\w+)\)", r"√\1", unit)
        return re.sub(r"[A-Za-z]+", lambda found: self.word(found[0], "units"), rooted)

    def number(self, formatted: str) -> str:
        """A number that `benchctl.reports.text` has formatted, with this language's decimal sign."""
        return _POINT.sub(self.tables["decimal"], formatted)

    def _told(self, value: str) -> str:
        """What fills a phrase: a number, a phrase, or whatever it is."""
        return self.number(value) if _NUMBER.fullmatch(value) else self.phrase(value)

    def _filled(self, name: str, value: float | str) -> str:
        if isinstance(value, str):
            tables = {"role": "roles", "status": "statuses", "source": "sources"}
            if name == "unit":
                return self.unit(value)
            return self.word(value, tables[name]) if name in tables else self.phrase(value)
        return self.number(short(value))


def short(value: float) -> str:
    """A number within a sentence: three digits, none of them a zero after the decimal sign."""
    if not 1e-3 <= abs(value) < 1e6:
        return text.number(value, _DIGITS) if value else "0"
    return text.plain(value, "", max(0, _DIGITS - 1 - math.floor(math.log10(abs(value)))))


@cache
def catalogue(language: str) -> Catalogue:
    """The words of one language; raises `UsageError` where the report is not written in it."""
    if language not in LANGUAGES:
        raise UsageError(f"--lang {language}: the report is written in {' or '.join(LANGUAGES)}; name one of them")
    file = files("benchctl.reports.acceptance").joinpath(f"{language}.toml")
    return Catalogue(language, tomllib.loads(file.read_text(encoding="utf-8")))


def _spelt(key: str) -> str:
    return key.replace("_", " ")
