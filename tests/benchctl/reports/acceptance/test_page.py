"""The acceptance report as a page."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from benchctl.metrology.result import Papers
from benchctl.recordings.model import Unit
from benchctl.reports.acceptance.build import report_of
from benchctl.reports.acceptance.catalogue import LANGUAGES
from benchctl.reports.acceptance.write import page
from tests.benchctl.reports.acceptance.example import HOSTILE, acceptance, facts, report
from tests.benchctl.reports.page import Page

_NAMES = "acceptance benchctl bench python numpy scipy points soak_s limits toml rate_sweep misalignment verify"
"""Words that a Russian report keeps: of programs, files and procedures."""


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return {language: page(report(language)) for language in LANGUAGES}


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_page_is_well_formed_needs_nothing_else_and_names_its_language(
    pages: dict[str, str], language: str
) -> None:
    found = Page(pages[language])
    assert found.refers_elsewhere() == []
    assert "http" not in pages[language]
    assert len(found.ids) == len(set(found.ids))
    assert ("html", {"lang": language}) in found.tags
    targets = [(attrs["href"] or "")[1:] for tag, attrs in found.tags if tag == "a"]
    assert len(targets) == 5
    assert set(targets) <= set(found.ids)


def test_another_page_is_still_in_english() -> None:
    from benchctl.reports.html import render

    assert '<html lang="en">' in render("base.html.j2")


@pytest.mark.parametrize(
    ("language", "words"),
    [
        (
            "en",
            ("PASS", "FAIL", "INCONCLUSIVE", "no limit", "not measured", "EXPIRED", "Source of uncertainty", "95.45 %"),
        ),
        ("ru", ("ПРОЙДЕНА", "НЕ ПРОЙДЕНА", "НЕ ОПРЕДЕЛЕНА", "НЕ ГОДЕН", "без допуска", "не измерено", "СРОК ИСТЁК")),
    ],
)
def test_every_verdict_and_every_warning_is_on_the_page(
    pages: dict[str, str], language: str, words: tuple[str, ...]
) -> None:
    told = Page(pages[language]).words
    assert [one for one in words if one not in told] == []


def test_the_english_page_says_what_was_found_how_and_by_which_rule(pages: dict[str, str]) -> None:
    told = Page(pages["en"]).words
    for sentence in (
        "5 tests judged: 2 passed, 1 failed, 2 inconclusive. Without a limit: 2. Not measured: 2.",
        "(49.7013 ± 0.0042) mV/(°/s)",
        "49.5 to 50.5 mV/(°/s)",
        "≥ 150.000 ± 0.020",
        "Guarded acceptance with a guard band of 1 U",
        "Slope K of the least-squares line",
        "No. 17-2026, revision 2",
        "Gyro laboratory · Optics street 1",
        "rate_sweep; unit at 20.1 °C; 31 × constant rate, −150 to 150 °/s; 15 min 30 s recorded",
        "rate_sweep; −40 to 20 °C (chamber set points)",
        "u = 0.0021; k = 2.00 for ∞ degrees of freedom, k·u = 0.0042;",
        "half the interval by Monte Carlo (JCGM 101): 0.0041. Stated: U = 0.0042 mV/(°/s).",
        "Scale factor: (49.7013 ± 0.0042) mV/(°/s), limit 49.5 to 50.5 mV/(°/s): PASS.",
        "results relate only to the unit named on the first page",
        "Measuring 4 times as long would make it conclusive: scatter is the largest contribution",
        "Run the procedure misalignment",
        "The recording holds sines at 0 frequencies; this test needs 4.",
        "The certificate of the chamber (Watlow F4T) had expired",
        "Step 35 (rest) was interrupted and made again",
        "The chamber's door was opened",
        "(50.001 ± 0.012) mV/(°/s)",
        "АО «Заказчик»",
        "after vibration",
        "accurate to 20″",
        "Approved by (QA)",
    ):
        assert sentence in told.replace("\u00a0", " "), sentence


def test_every_number_leads_back_to_its_steps_and_to_the_digest_of_the_recording(pages: dict[str, str]) -> None:
    told = Page(pages["en"]).words
    assert facts().digest in told
    assert acceptance().limits_sha256 in told
    assert "Steps (SHA-256 in the JSON) 1–31" in told
    assert "Steps (SHA-256 in the JSON) 32–33" in told


def test_a_report_without_a_number_is_named_by_day_unit_and_digest_and_has_no_laboratory() -> None:
    meta = facts().meta
    bare = facts(meta=replace(meta, provenance={"started_utc": "2026-11-20T18:00:00+00:00", "laboratory_logo": "iVBO"}))
    found = report_of(acceptance(papers=Papers(), judged=()), bare, "en")
    assert found.number == f"No. 20261120-VG-0917-{facts().digest[:8]}, revision 0"
    assert (found.laboratory, found.logo) == ((), b"")


def test_contributors_with_hardly_any_share_are_one_row() -> None:
    some = acceptance().judged[0]
    found = some.measured.uncertainty
    assert found is not None
    sizes = (1.0, 0.5, 0.01, 0.005, 0.0, 0.001)
    parts = tuple(replace(part, standard=size) for part, size in zip(found.contributors, sizes, strict=True))
    changed = replace(some, measured=replace(some.measured, uncertainty=replace(found, contributors=parts)))
    told = Page(page(report_of(acceptance(judged=(changed,)), facts(), "en"))).words.replace("\u00a0", " ")
    budget = told[told.index("Share of u²") :]
    assert re.search(r"scatter A 1\.0 80\.0 %", budget)
    assert "others, each < 0.1 % B 0.011 < 0.1 % converter's gain, clock, thermometer, mounting" in budget


def test_russian_numbers_have_commas_and_no_english_is_left(pages: dict[str, str]) -> None:
    found = Page(pages["ru"])
    told = found.words.replace("\u00a0", " ")
    assert "(49,7013 ± 0,0042) мВ/(°/с)" in told
    assert "от 49,5 до 50,5" in told
    assert "свидетельство D-2026-7.1, k = 2" in told
    assert not re.search(r"\d\.\d+ ±", told)
    names = set(re.findall(r"[a-z_]{4,}", _NAMES))
    told_so = {
        *re.findall("[a-z]+", facts().deviations[0]),
        *facts().coefficients[0].says.split(),
        "static",
        "stability",
        "rate",
        "rest",
        "step",
        "html",
        "json",
        "laboratory",
        "street",
    }
    digests = {word for word in re.findall(r"\b[a-z0-9]+\b", told) if re.fullmatch("[0-9a-f]{8,}", word)}
    assert set(re.findall(r"\b[a-z_]{4,}\b", told)) - names - told_so - digests == set()


def test_the_same_results_give_the_same_page(pages: dict[str, str]) -> None:
    assert page(report_of(acceptance(), facts(), "en")) == pages["en"]


def test_hostile_texts_cannot_run() -> None:
    hostile = acceptance(
        papers=Papers(title=HOSTILE, customer=HOSTILE, standard=HOSTILE, stage=HOSTILE, firmware=HOSTILE),
        limits_name=HOSTILE,
        judged=(),
    )
    meta = facts().meta
    provenance = {"operator": HOSTILE, "bench": HOSTILE, "instruments": HOSTILE, "software": "[" * 9000}
    told = facts(
        meta=replace(meta, unit=Unit(serial=HOSTILE, range_dps=0.0), provenance=provenance), deviations=(HOSTILE,)
    )
    html = page(report_of(hostile, told, "en"))
    assert "<script" not in html
    assert Page(html).words.count("<script>alert('1')</script>") > 8
    assert "no test was judged" in Page(html).words


def test_a_simulated_unit_is_said_to_be_one(pages: dict[str, str]) -> None:
    meta = facts().meta
    made = facts(meta=replace(meta, provenance={**meta.provenance, "bench_physics": "{}"}))
    assert "describe a model, not a device" in Page(page(report_of(acceptance(judged=()), made, "en"))).words
    assert "describe a model, not a device" not in Page(pages["en"]).words


def test_an_encoder_that_counts_backwards_is_said_under_the_mounting() -> None:
    from benchctl.bench import template

    meta = facts().meta
    text = template().replace("encoder_sign = 1 ", "encoder_sign = -1 ")
    made = facts(meta=replace(meta, provenance={**meta.provenance, "bench_toml": text}))
    told = Page(page(report_of(acceptance(judged=()), made, "en"))).words
    assert "encoder count reversed in bench.toml" in told


def test_an_empty_recording_has_a_report() -> None:
    meta = replace(facts().meta, provenance={})
    empty = facts(meta=meta, infos=(), deviations=(), coefficients=(), digest="")
    told = Page(page(report_of(acceptance(judged=(), anomalies=(), verdict="INCONCLUSIVE"), empty, "ru"))).words
    assert "Не обнаружены." in told
    assert "НЕ ОПРЕДЕЛЁН" in told
