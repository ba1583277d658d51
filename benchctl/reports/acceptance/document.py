"""The acceptance report as plain texts and tables in one language: what the page and the PDF both print."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from benchctl.reports.coefficient_tables import Coefficient
from benchctl.reports.figures import Drawing

Row = tuple[str, str]
"""A name and its value."""

TESTS_SECTION = 3
"""The number of the section whose parts are the tests that have a limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Badge:
    """A verdict as it is printed; `kind` is PASS, FAIL or INCONCLUSIVE, or empty where nothing is judged."""

    text: str
    kind: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table; `numeric` says of each column whether it holds numbers."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SummaryRow:
    """A test in the summary; `section` is the number of its section, `anchor` where that is."""

    test: str
    value: str
    limit: str
    verdict: Badge
    section: str
    anchor: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EquipmentRow:
    """An instrument; `expired`: its certificate had ended when the recording was made."""

    role: str
    model: str
    serial: str
    certificate: str
    until: str
    expired: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The uncertainty of a result: its contributors, how they combine, what stands out, how U was chosen."""

    contributors: Table
    totals: tuple[Row, ...]
    largest: str
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure as vectors for the page, and as pixels (PNG) for the PDF."""

    drawing: Drawing
    png: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """One test in full; `refused` says why it has no value."""

    number: str
    anchor: str
    name: str
    verdict: Badge
    result: tuple[Row, ...]
    refused: str
    remedy: str
    definition: str
    formula: str
    conditions: tuple[Row, ...]
    notes: tuple[str, ...]
    points: Table | None
    picture: Picture | None
    budget: Budget | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The whole report, in its order; a table without rows is left out."""

    language: str
    title: str
    serial: str
    started: datetime
    verdict: Badge
    heading: str
    tally: str
    simulated: str
    header: tuple[Row, ...]
    summary: tuple[SummaryRow, ...]
    rule: str
    equipment: tuple[EquipmentRow, ...]
    environment: tuple[Row, ...]
    sections: tuple[Section, ...]
    without_limit: Table
    not_measured: Table
    anomalies: tuple[str, ...]
    deviations: tuple[str, ...]
    coefficients: tuple[Coefficient, ...]
    traceability: tuple[Row, ...]
    steps: Table

    @property
    def numbers(self) -> Mapping[str, int]:
        """The numbers of the sections after that of the tests; one that is left out has none."""
        there = {
            "without_limit": bool(self.without_limit.rows),
            "not_measured": bool(self.not_measured.rows),
            "anomalies": True,
            "coefficients": bool(self.coefficients),
            "signatures": True,
        }
        names = [name for name, is_there in there.items() if is_there]
        return {name: place for place, name in enumerate(names, start=TESTS_SECTION + 1)}
