"""The acceptance report as a PDF, read by a foreign reader."""

from __future__ import annotations

import re
from dataclasses import replace

import pypdfium2
import pytest

from benchctl.metrology.result import Judged, Measured, Papers
from benchctl.recordings.model import Unit
from benchctl.reports.acceptance.build import report_of
from benchctl.reports.acceptance.catalogue import LANGUAGES, catalogue
from benchctl.reports.acceptance.write import pdf
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
    assert 4 <= len(pages) <= 5
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
        sentences += [*(text for row in test.result for text in row), test.conditions]
        if test.picture:
            sentences.append(test.picture.caption)
        if test.budget:
            sentences += [test.budget.totals, test.budget.says]
            sentences += [text for row in test.budget.contributors.rows for text in row]
    missing = [one for one in sentences if letters(one) not in told]
    assert missing == []


def letters(text: str) -> str:
    """Without spaces, line breaks and hyphens, which a reader of PDFs guesses."""
    return re.sub(r"[\s\u00ad\ufffe\u0002-]", "", text)


@pytest.mark.slow
def test_its_bytes_depend_on_the_results_alone(documents: dict[str, bytes]) -> None:
    assert pdf(report_of(acceptance(), facts(), "ru")) == documents["ru"]
    with pypdfium2.PdfDocument(documents["ru"]) as opened:
        about = opened.get_metadata_dict()
    assert about["CreationDate"].startswith("D:20261120180000")
    assert about["Title"] == "Протокол приёмочных испытаний: VG-0917"


def test_long_tables_go_on_over_the_page_with_their_headings_again() -> None:
    free = tuple(
        Judged(measured=Measured(name="scale_factor", unit="V", value=1000.0 + k), limit=None, verdict=None)
        for k in range(120)
    )
    document = pdf(report_of(acceptance(judged=free, step_digests={}), facts(infos=()), "en"))
    pages = text_of(document)
    assert beyond_the_margins(document) == []
    tables = [told for told in pages if "Definition and notes" in told]
    assert len(tables) > 1
    assert all(str(1000 + k) in " ".join(tables) for k in range(120))


def test_the_first_page_names_laboratory_report_unit_verdict_and_signatures(documents: dict[str, bytes]) -> None:
    first = text_of(documents["en"])[0]
    told = (
        "Gyro laboratory",
        "Optics street 1",
        "No. 17-2026, revision 2",
        "FAIL",
        "Unit VG-0917",
        "2026-11-20",
        "Approved by (QA)",
    )
    assert [one for one in told if one not in first] == []
    with pypdfium2.PdfDocument(documents["en"]) as opened:
        images = [one for one in opened[0].get_objects() if one.type == pypdfium2.raw.FPDF_PAGEOBJ_IMAGE]
    assert len(images) == 1


def test_no_text_is_smaller_than_eight_points(documents: dict[str, bytes]) -> None:
    with pypdfium2.PdfDocument(documents["ru"]) as opened:
        sizes = {
            pypdfium2.raw.FPDFText_GetFontSize(text, place)
            for text in (page.get_textpage() for page in opened)
            for place in range(text.count_chars())
        }
    assert min(size for size in sizes if size > 1.0) >= 8.0


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
