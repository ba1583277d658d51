"""The glossary is whole: every link leads somewhere, and all that reports print can be explained."""

from __future__ import annotations

import re
import typing

import pytest

from benchctl.diagnosis.result import COORDINATES, Verdict
from benchctl.explain.book import entries, find
from benchctl.explain.glossary import tables
from benchctl.metrology.allan import NAMES, TERMS
from benchctl.metrology.names import PROCEDURES, UNITS
from benchctl.plan.find import procedure_names
from benchctl.recordings.model import Status
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl.reports.diagnosis_words import _ONLY, _VERDICTS
from benchctl.reports.figures import PATH_LEVELS
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.registry import effects

_EN = catalogue("en").tables
PRINTED = {
    "names of acceptance results": [_EN["tests"][name]["name"] for name in UNITS],
    "results in JSON and limits.toml": list(UNITS),
    "verdicts of an acceptance": list(_EN["verdicts"].values()),
    "verdicts of a diagnosis": [*typing.get_args(Verdict), *_VERDICTS.values(), *_ONLY.values()],
    "effects": [*effects(), *drive_effects(), *chamber_effects()],
    "effects in a headline": [name.replace("_", " ") for name in effects()],
    "statuses": [*typing.get_args(Status), *_EN["statuses"], *_EN["statuses"].values()],
    "kinds of steps": [one for one in _EN["kinds"].values() if one != "not assigned"],
    "roles of instruments": list(_EN["roles"].values()),
    "terms of an Allan deviation": [*TERMS, *NAMES.values()],
    "levels of a calibration": [one for one in PATH_LEVELS.values() if one != "raw"],
    "columns and labels": ["error_percent", "expanded uncertainty", "type A", "type B", "uncertainty budget", "limit"],
}


@pytest.mark.parametrize("what", PRINTED)
def test_all_that_reports_print_is_explained(what: str) -> None:
    assert PRINTED[what]
    for label in PRINTED[what]:
        assert find(label), label


def test_every_link_leads_to_an_entry() -> None:
    for entry in entries():
        for name in (*entry.see, *entry.look_alikes):
            assert name in {one.name for one in find(name)}, f"{entry.name} -> {name}"


def test_nothing_is_said_of_an_effect_or_a_metric_that_there_is_not() -> None:
    ours = {*effects(), *drive_effects(), *chamber_effects()}
    assert set(tables()["effects"]) <= ours
    assert set(tables()["metrics"]) == set(UNITS)


def test_every_metric_says_how_it_is_computed_what_others_mean_and_which_procedure_measures_it() -> None:
    metrics = [one for one in entries() if one.group in ("metrics", "noise")]
    assert {one.name for one in metrics} == set(UNITS)
    for one in metrics:
        assert {"Unit", "Computed", "Others mean", "Measured by"} <= one.facts.keys(), one.name
        assert one.equation
        assert f"benchctl run {PROCEDURES[one.name]};" in one.facts["Measured by"]


def test_the_procedures_that_show_an_effect_are_installed_and_belong_to_a_coordinate() -> None:
    told = tables()["procedures"]
    assert {name for every in told.values() for name in every} <= set(procedure_names())
    assert {part for coordinate in told for part in coordinate.split("*")} <= set(COORDINATES)
    assert {one.coordinate for one in effects().values()} <= set(told)


def test_every_stage_that_an_effect_acts_on_is_told_in_words() -> None:
    for group, registry in (("gyro", effects()), ("drive", drive_effects()), ("chamber", chamber_effects())):
        assert {getattr(one, "stage", "") for one in registry.values()} <= set(tables()["stages"][group])


def test_terms_are_a_few_sentences_and_begin_with_a_short_one() -> None:
    terms = [entry for entry in entries() if entry.group not in ("gyro", "drive", "chamber", "metrics", "noise")]
    assert len(terms) >= 90
    for one in terms:
        sentences = re.findall(r"[.!?](?=\s|$)", one.words)
        assert 2 <= len(sentences) <= 6, one.name
        assert one.words.endswith((".", ".)")), one.name
        assert len(re.split(r"[.:;](?=\s)|[.]$", one.words)[0]) <= 76, one.name


def test_clauses_are_cited_of_published_documents_only() -> None:
    known = (
        "JCGM",
        "IEEE Std",
        "ISO/IEC 17043",
        "ILAC",
        "NIST",
        "Fizoptika",
        "Pavlov",
        "torquety",
        "Scientific Reports",
    )
    for one in entries():
        for source in one.sources:
            assert any(name in source for name in known), (one.name, source)
