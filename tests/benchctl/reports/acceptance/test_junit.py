"""JUnit XML as CI systems read it."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

import pytest

from benchctl.recordings.model import Unit
from benchctl.reports.acceptance.write import junit
from tests.benchctl.reports.acceptance.example import HOSTILE, acceptance, facts

CHILDREN = {
    "testsuites": {"testsuite"},
    "testsuite": {"properties", "testcase"},
    "testcase": {"properties", "failure", "skipped"},
    "properties": {"property"},
    "property": set(),
    "failure": set(),
    "skipped": set(),
}
NEEDED = {
    "testsuites": {"tests", "failures", "errors"},
    "testsuite": {"name", "tests", "failures", "errors", "skipped", "time", "timestamp", "hostname"},
    "testcase": {"name", "classname", "time"},
    "properties": set(),
    "property": {"name", "value"},
    "failure": {"message", "type"},
    "skipped": {"message"},
}


def checked(element: ET.Element) -> ET.Element:
    """The structure that the common schema of JUnit XML asks for."""
    assert element.attrib.keys() >= NEEDED[element.tag]
    for child in element:
        assert child.tag in CHILDREN[element.tag], f"{child.tag} in {element.tag}"
        checked(child)
    if element.tag == "testcase":
        assert sum(child.tag in ("failure", "skipped") for child in element) <= 1
    return element


@pytest.fixture(scope="module")
def suite() -> ET.Element:
    (found,) = checked(ET.fromstring(junit(acceptance(), facts())))
    return found


def case(suite: ET.Element, name: str) -> ET.Element:
    (found,) = suite.findall(f"testcase[@name='{name}']")
    return found


def properties(element: ET.Element) -> dict[str, str]:
    return {one.attrib["name"]: one.attrib["value"] for one in element.findall("properties/property")}


def test_the_suite_is_of_the_unit_and_counts_its_tests(suite: ET.Element) -> None:
    assert suite.attrib["name"] == "VG-0917 20261120-180000_acceptance_VG-0917"
    assert suite.attrib["timestamp"] == "2026-11-20T18:00:00"
    counts = [int(suite.attrib[name]) for name in ("tests", "failures", "errors", "skipped")]
    assert counts == [9, 3, 0, 2]
    assert len(suite.findall("testcase")) == 9
    assert len(suite.findall("testcase/failure")) == 3
    assert properties(suite)["verdict"] == "FAIL"
    assert properties(suite)["recording_sha256"] == facts().digest


def test_a_test_that_passes_has_its_numbers_and_no_failure(suite: ET.Element) -> None:
    passed = case(suite, "scale_factor")
    assert [child.tag for child in passed] == ["properties"]
    told = properties(passed)
    assert told == {
        "value": "49.7013",
        "uncertainty": "0.0042",
        "limit_low": "49.5",
        "limit_high": "50.5",
        "unit": "mV/(deg/s)",
    }


@pytest.mark.parametrize(
    ("name", "kind", "message"),
    [
        ("nonlinearity_reading", "limit", "(1.310 ± 0.040) %, expected ≤ 1 %"),
        ("bias", "inconclusive", "(−98.9 ± 4.2) °/h, expected −100 to 100 °/h"),
        ("misalignment", "inconclusive", "The recording holds no turning about an axis across the input axis."),
    ],
)
def test_failed_and_open_tests_are_failures_of_their_kind(
    suite: ET.Element, name: str, kind: str, message: str
) -> None:
    (failure,) = case(suite, name).findall("failure")
    assert failure.attrib["type"] == kind
    assert failure.attrib["message"].replace("\u00a0", " ") == message
    assert (failure.text or "").startswith(failure.attrib["message"])


def test_what_would_settle_an_open_test_is_in_its_text(suite: ET.Element) -> None:
    assert "Run the procedure misalignment" in (case(suite, "misalignment").findtext("failure") or "")


def test_without_a_limit_a_test_is_skipped_where_it_has_no_value(suite: ET.Element) -> None:
    (skipped,) = case(suite, "bandwidth").findall("skipped")
    assert "needs 4" in skipped.attrib["message"]
    assert [child.tag for child in case(suite, "input_range")] == ["properties"]
    assert properties(case(suite, "input_range"))["bound"] == "at least"


def test_hostile_texts_are_escaped_and_what_xml_cannot_hold_is_replaced() -> None:
    meta = replace(facts().meta, unit=Unit(serial=HOSTILE, range_dps=1.0))
    text = junit(acceptance(limits_name=HOSTILE), facts(meta=meta))
    assert "<script" not in text
    assert "\x00" not in text
    (suite,) = checked(ET.fromstring(text))
    assert suite.attrib["name"].startswith("<script>alert('1')</script>&\"\ufffd")
