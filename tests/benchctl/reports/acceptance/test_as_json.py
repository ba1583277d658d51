"""The acceptance for programs."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path

import pytest

from benchctl.app.accept import lines
from benchctl.reports.acceptance.write import values, write_acceptance
from tests.benchctl.reports.acceptance.example import DIGESTS, acceptance, facts, uncertainty
from tests.benchctl.reports.acceptance.test_pdf import text_of

KEYS = {
    "verdict",
    "tally",
    "tests",
    "unit_under_test",
    "started_utc",
    "stage",
    "limits",
    "rule",
    "recording",
    "recording_digest",
    "anomalies",
}
TEST_KEYS = {
    "name",
    "value",
    "unit",
    "stated",
    "uncertainty",
    "k",
    "dof",
    "limit",
    "verdict",
    "remedy",
    "bound",
    "refused",
    "notes",
    "standard",
    "monte_carlo",
    "budget",
    "temperature_c",
    "steps",
}


def test_every_key_is_there_for_every_test() -> None:
    told = values(acceptance(), facts())
    assert told.keys() == KEYS
    assert [test.keys() for test in told["tests"]] == [TEST_KEYS] * 9
    assert json.loads(json.dumps(told, allow_nan=False)) == told


def test_numbers_are_not_rounded_and_lead_back_to_steps() -> None:
    first, *_ = values(acceptance(), facts())["tests"]
    assert first["value"] == 49.7013
    assert first["uncertainty"] == 2 * first["standard"] == 0.0042
    assert first["limit"] == {"low": 49.5, "high": 50.5, "unit": "mV/(deg/s)"}
    assert first["steps"][0] == {"index": 1, "name": "rate -150", "digest": DIGESTS[1]}
    assert len(first["steps"]) == 31
    assert [part["source"] for part in first["budget"]][:2] == ["scatter", "encoder"]
    assert first["budget"][0].keys() == {"source", "standard", "dof", "kind", "says"}
    assert first["budget"][0]["standard"] == pytest.approx(uncertainty(0.0021).contributors[0].standard)


def test_page_pdf_and_terminal_print_a_result_and_the_counts_as_json_does(tmp_path: Path) -> None:
    found = acceptance()
    told = values(found, facts())
    written = write_acceptance(found, facts(), tmp_path, "en")
    faces = {
        "page": unescape(written["report"].read_text()),
        "pdf": "".join(text_of(written["pdf"].read_bytes())),
        "terminal": lines(found, "en"),
    }
    bare = {name: re.sub(r"\s+", "", shown) for name, shown in faces.items()}
    stated = [test["stated"] for test in told["tests"] if test["value"] is not None]
    assert "(49.7013\u00a0±\u00a00.0042)\u00a0mV/(°/s)" in stated
    for wanted in (told["tally"], *stated):
        number = re.sub(r"\s+", "", wanted)
        for name, shown in bare.items():
            # a table has the unit in its heading
            assert number in shown or number.replace("(", "").partition(")")[0] in shown, (name, wanted)


def test_sentences_are_english_and_what_is_not_there_is_null() -> None:
    told = values(acceptance(), facts())
    tests = {test["name"]: test for test in told["tests"]}
    assert tests["bandwidth"]["value"] is None
    assert tests["bandwidth"]["uncertainty"] is None
    assert tests["bandwidth"]["limit"] is None
    assert tests["bandwidth"]["verdict"] is None
    assert tests["bandwidth"]["refused"].endswith("this test needs 4.")
    assert tests["bias"]["notes"] == ["Earth's rate about the input axis, 12.8 °/h, has been taken off."]
    assert tests["input_range"]["bound"] == "at least"
    assert told["limits"] == {"file": "limits.toml", "sha256": acceptance().limits_sha256, "text": "guard = 1.0"}
    assert told["rule"]["guard"] == 1.0
    assert told["anomalies"][1] == "The recording is not complete: interrupted by the operator."


def test_a_number_that_json_cannot_hold_is_null() -> None:
    from dataclasses import replace

    one = acceptance().judged[0]
    odd = replace(uncertainty(1.0), monte_carlo=float("nan"), expanded=float("inf"))
    judged = replace(one, measured=replace(one.measured, uncertainty=odd))
    (test,) = values(acceptance(judged=(judged,)), facts())["tests"]
    assert test["monte_carlo"] is None
    assert test["uncertainty"] is None
