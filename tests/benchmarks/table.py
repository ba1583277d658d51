"""Figures as a table in Markdown, with what they were measured on."""

from __future__ import annotations

from collections.abc import Sequence

from benchctl.reports.text import number
from tests.benchmarks.comparison import Comparison
from tests.benchmarks.machine import Conditions

_HEADINGS = ("what", "ours", "theirs", "ratio", "goal", "reached")
SIGNS = {"<=": "≤", ">=": "≥"}


def table(found: Sequence[Comparison], conditions: Conditions) -> str:
    """A row a figure, in the order in which they were measured."""
    rows = [_HEADINGS, ("---",) * len(_HEADINGS), *(_row(one) for one in found)]
    lines = ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows]
    return "\n".join([*lines, "", f"{conditions.machine}; {conditions.date}; {conditions.versions}."])


def goal_of(one: Comparison) -> str:
    """The ratio that is to be reached: `≤ 0.05`."""
    return f"{SIGNS[one.sense]} {one.bound:g}"


def _row(one: Comparison) -> tuple[str, ...]:
    return (
        one.name,
        f"{number(one.value)} {one.unit}",
        f"{number(one.against_value)} {one.unit} ({one.against})",
        number(one.ratio),
        goal_of(one),
        "yes" if one.reached else "no",
    )
