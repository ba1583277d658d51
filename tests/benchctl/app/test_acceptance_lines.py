"""The acceptance for a terminal."""

from __future__ import annotations

import pytest

from benchctl.app.accept import lines
from benchctl.reports.acceptance.catalogue import LANGUAGES
from tests.benchctl.reports.acceptance.example import acceptance


@pytest.mark.parametrize("language", LANGUAGES)
def test_each_test_has_a_line_of_at_most_120_characters(language: str) -> None:
    *tests, last = lines(acceptance(), language).splitlines()
    assert len(tests) == 9
    assert max(map(len, tests)) <= 120
    assert last.startswith("FAIL. 5 tests judged" if language == "en" else "НЕ ГОДЕН. ")


def test_columns_are_aligned() -> None:
    tests = lines(acceptance()).splitlines()[:4]
    assert tests[0].split("  ")[0] == "Scale factor"
    places = {line.index("PASS" if "PASS" in line else "FAIL" if "FAIL" in line else "INCONCLUSIVE") for line in tests}
    assert len(places) == 1
    assert "(49.7013 ± 0.0042) mV/(°/s)" in tests[0]
    assert "49.5 to 50.5" in tests[0]


def test_without_tests_only_the_verdict_is_said() -> None:
    assert lines(acceptance(judged=(), verdict="INCONCLUSIVE")).startswith("INCONCLUSIVE. 0 tests judged")
