"""For a lab engineer: what a finding does to the calibration, and what to do at the bench."""

import pytest

from benchctl.explain.book import find
from benchctl.reports.diagnosis_tables import known_effects
from benchctl.reports.vocabulary import advice_for
from tests.benchctl.diagnosis.example import nothing_missing, pair
from tests.benchctl.reports.page import Page
from tests.benchctl.reports.test_diagnosis_page import page_of, undrawn


@pytest.mark.parametrize("effect", known_effects())
def test_there_is_advice_for_every_effect_of_ours(effect: str) -> None:
    advice = advice_for(effect)
    assert advice is not None
    assert len({advice.calibration, advice.bench}) == 2


def test_there_is_none_for_an_effect_of_another_package() -> None:
    assert advice_for("theirs") is None


def test_the_report_says_it_of_each_finding_and_explain_of_the_effect() -> None:
    page = Page(page_of(undrawn(pair())))
    for finding in pair().findings:
        advice = advice_for(finding.effect)
        assert advice is not None
        assert advice.calibration in page.words
        assert advice.bench in page.words
        (entry,) = find(finding.effect)
        assert entry.facts["At the bench"] == advice.bench
    assert "For the bench" not in Page(page_of(undrawn(nothing_missing()))).words
