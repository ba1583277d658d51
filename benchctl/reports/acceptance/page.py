"""The acceptance report as one HTML page that needs nothing else."""

from __future__ import annotations

from benchctl.reports.acceptance.catalogue import catalogue
from benchctl.reports.acceptance.document import Report
from benchctl.reports.html import render


def page(report: Report) -> str:
    """The page as text; the same report gives the same bytes."""
    words = catalogue(report.language)
    return render("acceptance/acceptance.html.j2", report=report, words=words, numbers=report.numbers)
