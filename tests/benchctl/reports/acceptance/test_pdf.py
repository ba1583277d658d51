"""The acceptance report as a PDF, read by a foreign reader."""

from __future__ import annotations

import re
from dataclasses import replace

import pypdfium2
import pytest

from benchctl.metrology.result import Column, Judged, Measured, Papers
from benchctl.recordings.model import Unit
from benchctl.reports.acceptance.build import report_of
from benchctl.reports.acceptance.catalogue import LANGUAGES, catalogue
from benchctl.reports.acceptance.pdf import pdf
from tests.benchctl.reports.acceptance.example import HOSTILE, acceptance, facts, report

A4_PT = (595.28, 841.89)
MARGIN_PT = 40.0


def text_of(document: bytes) -> list[str]:
    with pypdfium2.PdfDocument(document) as opened:
        return [" ".join(page.get_textpage().get_text_bounded().split()) for page in opened]


def beyond_the_margins(document: bytes) -> list[str]:
    """Characters outside of the text block, or below its foot."""
    found = []
    with pypdfium2.PdfDocument(document) as opened:
        for number, page in enumerate(opened, start=1):
            assert page.get_size() == pytest.approx(A4_PT, abs=0.1)
            text = page.get_textpage()
            for place in range(text.count_chars()):
                left, bottom, right, top = text.get_charbox(place)
                inside = (
                    left >= MARGIN_PT and right <= A4_PT[0] - MARGIN_PT and bottom >= 20.0 and top <= A4_PT[1] - 20.0
                )
                if not inside:
                    found.append(f"page {number}: {text.get_text_range(place, 1)!r} at {left:.0f}, {bottom:.0f}")
    return found


@pytest.fixture(scope="module")
def documents() -> dict[str, bytes]:
    return {language: pdf(report(language)) for language in LANGUAGES}


@pytest.mark.parametrize("language", LANGUAGES)
def test_nothing_is_cut_off(documents: dict[str, bytes], language: str) -> None:
    assert beyond_the_margins(documents[language]) == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_each_page_has_the_unit_the_verdict_and_its_number(documents: dict[str, bytes], language: str) -> None:
    words, pages = catalogue(language), text_of(documents[language])
    assert 6 <= len(pages) <= 8
    for number, told in enumerate(pages, start=1):
        assert words.label("serial_short", serial="VG-0917") in told
        assert words.word("unit_FAIL", "verdicts") in told
        assert words.label("page", page=str(number), pages=str(len(pages))) in told


@pytest.mark.parametrize("language", LANGUAGES)
def test_it_says_what_the_page_says(documents: dict[str, bytes], language: str) -> None:
    told = letters(" ".join(text_of(documents[language])))
    stated = report(language)
    sentences = [stated.tally, stated.rule, *stated.anomalies, *stated.deviations]
    sentences += [text for row in stated.header + stated.environment + stated.traceability for text in row]
    sentences += [text for row in stated.summary for text in (row.test, row.value, row.limit, row.verdict.text)]
    sentences += [text for row in stated.equipment for text in (row.role, row.model, row.serial, row.until)]
    for test in stated.sections:
        sentences += [test.name, test.definition, test.formula, test.refused, test.remedy, *test.notes]
        sentences += [text for row in (*test.result, *test.conditions) for text in row]
        if test.budget:
            sentences += [
                test.budget.largest,
                test.budget.says,
                *(t for row in test.budget.contributors.rows for t in row),
            ]
        if test.points:
            sentences += [cell for row in test.points.rows for cell in row]
    missing = [one for one in sentences if letters(one) not in told]
    assert missing == []


def letters(text: str) -> str:
    """Without spaces and line breaks, which a reader of PDFs guesses."""
    return re.sub(r"[\s\u00ad\ufffe\u0002]", "", text)


@pytest.mark.slow
def test_its_bytes_depend_on_the_results_alone(documents: dict[str, bytes]) -> None:
    assert pdf(report_of(acceptance(), facts(), "ru")) == documents["ru"]
    with pypdfium2.PdfDocument(documents["ru"]) as opened:
        about = opened.get_metadata_dict()
    assert about["CreationDate"].startswith("D:20261120180000")
    assert about["Title"] == "Протокол приёмочных испытаний: VG-0917"


def test_long_tables_go_on_over_the_page_with_their_headings_again() -> None:
    values = tuple(float(k) for k in range(400))
    columns = (Column(name="rate", unit="deg/s", values=values), Column(name="output", unit="V", values=values))
    long = Judged(
        measured=Measured(name="scale_factor", unit="mV/(deg/s)", value=50.0, table=columns),
        limit=acceptance().judged[0].limit,
        verdict="PASS",
    )
    document = pdf(report_of(acceptance(judged=(long,), step_digests={}), facts(infos=()), "en"))
    pages = text_of(document)
    assert beyond_the_margins(document) == []
    tables = [told for told in pages if "output, V" in told]
    assert len(tables) > 1
    assert all(re.search(rf"\b{k}\b", " ".join(tables)) for k in range(400))


def test_hostile_and_endless_texts_stay_on_the_sheet() -> None:
    endless = "x" * 5000
    meta = facts().meta
    told = {"operator": endless, "bench": HOSTILE, "parameters": '{"a": "' + endless + '"}', "instruments": "[" * 5000}
    strange = facts(
        meta=replace(meta, unit=Unit(serial=endless, range_dps=1.0, model=HOSTILE), provenance=told),
        deviations=(endless, HOSTILE),
        infos=tuple(replace(info, name=endless) for info in facts().infos[:3]),
    )
    papers = Papers(title=endless, customer=HOSTILE, standard="a b " * 800, stage=HOSTILE, firmware=endless)
    document = pdf(report_of(acceptance(papers=papers, limits_name=endless, judged=()), strange, "en"))
    assert beyond_the_margins(document) == []
    told_all = " ".join(text_of(document))
    assert "<script>alert('1')</script>&" in told_all
    assert "日" not in told_all


@pytest.mark.parametrize("verdict", ["PASS", "INCONCLUSIVE"])
def test_a_report_without_tests_can_be_printed(verdict: str) -> None:
    empty = acceptance(judged=(), anomalies=(), verdict=verdict, step_digests={})
    meta = replace(facts().meta, provenance={"started_utc": "yesterday", "bench_physics": "{}"})
    document = pdf(report_of(empty, facts(meta=meta, infos=(), deviations=(), coefficients=(), digest=""), "ru"))
    assert len(text_of(document)) == 2
    assert beyond_the_margins(document) == []
