"""The content of the acceptance report as texts and tables in one language, common to the page and the PDF."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from benchctl.reports.coefficient_tables import Coefficient
from benchctl.reports.figures import Drawing, embedded

Row = tuple[str, str]
"""A name and its value."""

TESTS_SECTION = 3
"""The number of the section that contains the tests with a limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Badge:
    """A printed verdict; `kind` is PASS, FAIL or INCONCLUSIVE, or empty without a judgement."""

    text: str
    kind: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table; `numeric` states for each column whether it contains numbers."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SummaryRow:
    """A test in the summary; `section` is the number of its section, `anchor` the target of the link."""

    test: str
    value: str
    limit: str
    verdict: Badge
    section: str
    anchor: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EquipmentRow:
    """An instrument; `expired`: its certificate was no longer valid at the time of the recording."""

    role: str
    model: str
    serial: str
    certificate: str
    until: str
    expired: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The uncertainty of a result: contributors, and sentences on their combination and the coverage factor."""

    contributors: Table
    totals: str
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure of half the text's width, for page and PDF."""

    png: bytes
    caption: str

    @property
    def drawing(self) -> Drawing:
        """The figure for the page."""
        return Drawing(svg=embedded(self.png), alt=self.caption, caption=self.caption)


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """The section of one test; `refused` is the reason for a missing value."""

    number: str
    anchor: str
    name: str
    verdict: Badge
    result: tuple[Row, ...]
    refused: str
    remedy: str
    definition: str
    formula: str
    conditions: str
    steps: str
    notes: tuple[str, ...]
    points: Table | None
    picture: Picture | None
    budget: Budget | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The complete report, in the order of its sections; a table without rows is omitted.

    `laboratory` are its name and address, `logo` is its PNG image; empty if the bench states none. `signed` states the
    key by which the report is signed; empty if it is not signed electronically.
    """

    language: str
    title: str
    number: str
    laboratory: tuple[str, ...]
    logo: bytes
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
    signed: str
    traceability: tuple[Row, ...]

    @property
    def numbers(self) -> Mapping[str, int]:
        """The numbers of the sections after that of the tests; omitted sections have none."""
        present = {
            "without_limit": bool(self.without_limit.rows),
            "not_measured": bool(self.not_measured.rows),
            "coefficients": bool(self.coefficients),
        }
        names = [name for name, is_present in present.items() if is_present]
        return {name: place for place, name in enumerate(names, start=TESTS_SECTION + 1)}
