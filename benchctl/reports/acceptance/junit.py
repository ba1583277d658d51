"""The acceptance as JUnit XML, which CI systems show: a test suite of the unit, a test case for each test.

A test case that is INCONCLUSIVE is a failure of type `inconclusive`, since nothing may be accepted on it; without a
limit a test is skipped where it has no value, and else passes with its value among the properties.
"""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

from benchctl.metrology.result import Acceptance, Judged
from benchctl.reports.acceptance.catalogue import Catalogue, catalogue
from benchctl.reports.acceptance.recording_facts import RecordingFacts
from benchctl.reports.acceptance.values import limits, stated

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot hold, not even escaped."""


def junit(acceptance: Acceptance, facts: RecordingFacts) -> str:
    """The XML, in English, whatever the language of the report."""
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
        message = verdict_says(one, words)
        failure = ET.SubElement(case, "failure")
        _set(failure, type=kind, message=message)
        failure.text = _clean(" ".join([message, *([words.said(one.remedy)] if one.remedy else [])]))


def properties_of(one: Judged) -> dict[str, str]:
    """A test's figures, by name; what there is none of is empty."""
    measured = one.measured
    expanded = measured.uncertainty.expanded if measured.uncertainty else None
    return {
        "value": "" if measured.value is None else repr(measured.value),
        "uncertainty": "" if expanded is None else repr(expanded),
        "limit_low": "" if one.limit is None or one.limit.low is None else repr(one.limit.low),
        "limit_high": "" if one.limit is None or one.limit.high is None else repr(one.limit.high),
        "unit": measured.unit,
        "bound": measured.bound,
    }


def verdict_says(one: Judged, words: Catalogue) -> str:
    """Why there is no value of a test with a limit, or its value and what was expected."""
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
