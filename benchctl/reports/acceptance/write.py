"""The acceptance report's files in a folder: page, PDF, JUnit XML and JSON, each whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path

from benchctl.atomic import whole_file
from benchctl.metrology.result import Acceptance
from benchctl.reports.acceptance.as_json import SCHEMA, values
from benchctl.reports.acceptance.build import report_of
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl.reports.acceptance.document import Report
from benchctl.reports.acceptance.junit import junit
from benchctl.reports.acceptance.pdf import pdf
from benchctl.reports.acceptance.recording_facts import RecordingFacts
from benchctl.reports.html import render
from benchctl.reports.results import make_folder

PAGE, PDF, JUNIT, JSON = "acceptance.html", "acceptance.pdf", "acceptance.xml", "acceptance.json"


def write_acceptance(
    acceptance: Acceptance, facts: RecordingFacts, folder: Path, language: str = "en"
) -> dict[str, Path]:
    """Write the four files; their paths by `report`, `pdf`, `junit` and `json`.

    Page and PDF are in the language, JUnit XML and JSON in English. All four are made before the first is written.

    Raises
    ------
    UsageError
        Where the report is not written in that language, or the folder or the disk refuses.
    """
    report = report_of(acceptance, facts, language)
    told = json.dumps({"schema": SCHEMA, **values(acceptance, facts)}, indent=1, ensure_ascii=False, allow_nan=False)
    files = {
        "report": (PAGE, page(report).encode("utf-8")),
        "pdf": (PDF, pdf(report)),
        "junit": (JUNIT, junit(acceptance, facts).encode("utf-8")),
        "json": (JSON, f"{told}\n".encode()),
    }
    make_folder(folder)
    for name, content in files.values():
        with whole_file(folder / name) as temporary:
            temporary.write_bytes(content)
    return {kind: folder / name for kind, (name, _) in files.items()}


def page(report: Report) -> str:
    """The page as text; the same report gives the same bytes."""
    words = catalogue(report.language)
    return render("acceptance/acceptance.html.j2", report=report, words=words, numbers=report.numbers)
