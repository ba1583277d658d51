"""The files of an acceptance: JSON, JUnit, HTML and PDF, each written atomically.

In the JSON every number is unrounded and every sentence is English. In JUnit the unit is a test suite and each test a
test case. INCONCLUSIVE is a failure of type `inconclusive`, because it does not allow acceptance. A test without a
limit is skipped if it has no value, and otherwise passes with its value among the properties.
"""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import matplotlib as mpl
import typst
from matplotlib.ft2font import FT2Font

from benchctl.atomic import whole_file
from benchctl.documents import json_values
from benchctl.limits import cut
from benchctl.metrology.result import Acceptance, Judged, Limit, Uncertainty
from benchctl.reports.acceptance.build import report_of, tally
from benchctl.reports.acceptance.catalogue import Catalogue, catalogue, limits, stated
from benchctl.reports.acceptance.document import Report
from benchctl.reports.acceptance.set_up import RecordingFacts
from benchctl.reports.acceptance.signed import JSON, JUNIT, PAGE, PDF
from benchctl.reports.html import render
from benchctl.reports.results import make_folder
from benchctl.sshsig import SigningKey

_FONTS = Path(mpl.get_data_path(), "fonts", "ttf")
"""DejaVu Sans, which matplotlib contains: it includes Cyrillic and the letters of formulas."""
_LONGEST = 3000
"""Maximum number of characters of user text."""


def pdf(report: Report) -> bytes:
    """Return the PDF that Typst sets from `acceptance.typ`; the same report gives the same bytes."""
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


_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot contain, even escaped."""


def junit(acceptance: Acceptance, facts: RecordingFacts) -> str:
    """Return the JUnit XML, in English for every language of the report."""
    words = catalogue("en")
    suite = ET.Element("testsuite")
    name = f"{facts.meta.unit.serial} {facts.name}"
    failures = sum(one.verdict in ("FAIL", "INCONCLUSIVE") for one in acceptance.judged)
    skipped = sum(_is_skipped(one) for one in acceptance.judged)
    counts = {"tests": len(acceptance.judged), "failures": failures, "errors": 0, "skipped": skipped}
    _set(suite, name=name, **{key: str(value) for key, value in counts.items()}, time="0")
    _set(suite, timestamp=facts.started.replace(tzinfo=None).isoformat(timespec="seconds"), hostname="")
    _properties(
        suite,
        {
            "verdict": acceptance.verdict,
            "rule": words.said(acceptance.rule.says),
            "limits": acceptance.limits_name,
            "limits_sha256": acceptance.limits_sha256,
            "recording_sha256": facts.digest,
        },
    )
    for one in acceptance.judged:
        _case(suite, one, facts.meta.unit.serial, words)
    suites = ET.Element("testsuites")
    _set(suites, **{key: str(value) for key, value in counts.items()})
    suites.append(suite)
    ET.indent(suites)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(suites, encoding="unicode") + "\n"


def _is_skipped(one: Judged) -> bool:
    return one.verdict is None and one.measured.value is None


def _case(suite: ET.Element, one: Judged, serial: str, words: Catalogue) -> None:
    measured = one.measured
    case = ET.SubElement(suite, "testcase")
    _set(case, classname=serial, name=measured.name, time="0")
    _properties(case, properties_of(one))
    if _is_skipped(one):
        _set(ET.SubElement(case, "skipped"), message=_why(one, words))
    elif one.verdict in ("FAIL", "INCONCLUSIVE"):
        kind = "limit" if one.verdict == "FAIL" else "inconclusive"
        failure = ET.SubElement(case, "failure")
        _set(failure, type=kind, message=_verdict_says(one, words))
        failure.text = _clean(reason_of(one, words))


def properties_of(one: Judged) -> dict[str, str]:
    """Return a test's figures by name, without those that are missing."""
    measured = one.measured
    expanded = measured.uncertainty.expanded if measured.uncertainty else None
    figures = {
        "value": "" if measured.value is None else repr(measured.value),
        "uncertainty": "" if expanded is None else repr(expanded),
        "limit_low": "" if one.limit is None or one.limit.low is None else repr(one.limit.low),
        "limit_high": "" if one.limit is None or one.limit.high is None else repr(one.limit.high),
        "unit": measured.unit,
        "bound": measured.bound,
    }
    return {name: value for name, value in figures.items() if value}


def reason_of(one: Judged, words: Catalogue) -> str:
    """Return the reason for a verdict, and what would make an inconclusive one conclusive."""
    return " ".join([_verdict_says(one, words), *([words.said(one.remedy)] if one.remedy else [])])


def _verdict_says(one: Judged, words: Catalogue) -> str:
    """Return the reason for a missing value of a test with a limit, or its value and the limits."""
    return _why(one, words) or f"{stated(one.measured, words)}, expected {limits(one.limit, words)}"


def _why(one: Judged, words: Catalogue) -> str:
    return words.said(one.measured.refused) if one.measured.refused else ""


def _properties(parent: ET.Element, told: dict[str, str]) -> None:
    holder = ET.SubElement(parent, "properties")
    for name, value in told.items():
        if value:
            _set(ET.SubElement(holder, "property"), name=name, value=value)


def _set(element: ET.Element, **attributes: str) -> None:
    for name, value in attributes.items():
        element.set(name, _clean(value))


def _clean(told: str) -> str:
    return _NOT_XML.sub("\ufffd", told)


SCHEMA = "benchctl-acceptance/1"


def values(acceptance: Acceptance, facts: RecordingFacts) -> dict[str, Any]:
    """Return an acceptance as plain data for `--json`.

    `uncertainty` of a test is expanded (95.45 %, `k` times the combined `standard`; `dof` null: infinite), and `stated`
    is the value with its uncertainty as printed in the report.
    """
    words = catalogue("en")
    names = {info.index: info.name for info in facts.infos}
    return {
        "verdict": acceptance.verdict,
        "tally": tally(acceptance, words),
        "tests": [_test(one, acceptance, names, words) for one in acceptance.judged],
        "unit_under_test": {"serial": facts.meta.unit.serial, "model": facts.meta.unit.model},
        "started_utc": facts.meta.provenance.get("started_utc", ""),
        "stage": acceptance.papers.stage,
        "limits": {
            "file": acceptance.limits_name,
            "sha256": acceptance.limits_sha256,
            "text": acceptance.limits_text,
        },
        "rule": {"guard": acceptance.rule.guard, "says": words.said(acceptance.rule.says)},
        "recording": str(facts.path),
        "recording_digest": facts.digest,
        "anomalies": [words.said(one) for one in acceptance.anomalies],
    }


def _test(one: Judged, acceptance: Acceptance, names: dict[int, str], words: Catalogue) -> dict[str, Any]:
    measured = one.measured
    return {
        "name": measured.name,
        "value": json_values(measured.value),
        "unit": measured.unit,
        "stated": stated(measured, words),
        "limit": _limit(one.limit),
        "verdict": one.verdict,
        "remedy": words.said(one.remedy) if one.remedy else "",
        "bound": measured.bound,
        "refused": words.said(measured.refused) if measured.refused else "",
        "notes": [words.said(note) for note in measured.notes],
        "temperature_c": json_values(measured.temperature_c),
        "steps": [
            {"index": index, "name": names.get(index, ""), "digest": acceptance.step_digests.get(index, "")}
            for index in measured.steps
        ],
        **_uncertainty(measured.uncertainty),
    }


def _limit(limit: Limit | None) -> dict[str, Any] | None:
    return None if limit is None else {"low": limit.low, "high": limit.high, "unit": limit.unit}


def _uncertainty(found: Uncertainty | None) -> dict[str, Any]:
    if found is None:
        return {"uncertainty": None, "k": None, "dof": None, "standard": None, "monte_carlo": None, "budget": []}
    return {
        "uncertainty": json_values(found.expanded),
        "k": found.k,
        "dof": json_values(found.dof),
        "standard": json_values(found.standard),
        "monte_carlo": json_values(found.monte_carlo),
        "budget": [
            {
                "source": part.source,
                "standard": json_values(part.standard),
                "dof": json_values(part.dof),
                "kind": part.kind,
                "says": part.says,
            }
            for part in found.contributors
        ],
    }


def write_acceptance(
    acceptance: Acceptance, facts: RecordingFacts, folder: Path, language: str = "en", key: SigningKey | None = None
) -> dict[str, Path]:
    """Write the four files; return their paths by `report`, `pdf`, `junit` and `json`.

    Page and PDF are in `language`, JUnit XML and JSON in English. All four are created before the first is written.
    Page and PDF state the `key` by which they will be signed, if any; nothing is signed here.

    Raises
    ------
    UsageError
        If the language is not supported, or a file cannot be written.
    """
    report = report_of(acceptance, facts, language, key)
    document = json.dumps(
        {"schema": SCHEMA, **values(acceptance, facts)}, indent=1, ensure_ascii=False, allow_nan=False
    )
    files = {
        "report": (PAGE, page(report).encode("utf-8")),
        "pdf": (PDF, pdf(report)),
        "junit": (JUNIT, junit(acceptance, facts).encode("utf-8")),
        "json": (JSON, f"{document}\n".encode()),
    }
    make_folder(folder)
    for name, content in files.values():
        with whole_file(folder / name) as temporary:
            temporary.write_bytes(content)
    return {kind: folder / name for kind, (name, _) in files.items()}


def page(report: Report) -> str:
    """Return the page as text; the same report gives the same bytes."""
    words = catalogue(report.language)
    return render("acceptance/acceptance.html.j2", report=report, words=words, numbers=report.numbers)
