"""The words of the report: both languages say the same things, and all that the metrology can hand over."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from importlib.resources import files
from string import Formatter

import matplotlib as mpl
import pytest
from matplotlib.ft2font import FT2Font

from benchctl.metrology.names import UNITS
from benchctl.metrology.result import PLACEHOLDERS, Message, message
from benchctl.reports.acceptance.catalogue import LANGUAGES, catalogue, short
from benchctl_instruments.errors import UsageError
from tests.benchctl.reports.acceptance import spoken


def texts(language: str) -> dict[str, str]:
    def flat(table: dict[str, object], way: str = "") -> Iterator[tuple[str, str]]:
        for key, value in table.items():
            if isinstance(value, dict):
                yield from flat(value, f"{way}{key}.")
            else:
                yield f"{way}{key}", str(value)

    source = files("benchctl.reports.acceptance").joinpath(f"{language}.toml").read_text(encoding="utf-8")
    return dict(flat(tomllib.loads(source)))


def placeholders(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name}


def test_both_languages_have_the_same_keys_with_the_same_placeholders() -> None:
    english, russian = texts("en"), texts("ru")
    assert sorted(english.keys() ^ russian.keys()) == []
    assert {key for key in english if placeholders(english[key]) != placeholders(russian[key])} == set()


@pytest.mark.parametrize("language", LANGUAGES)
def test_there_is_a_sentence_for_all_that_can_be_said_and_no_other(language: str) -> None:
    sentences = catalogue(language).tables["said"]
    assert sorted(PLACEHOLDERS.keys() - sentences.keys()) == [], "PLACEHOLDERS has keys without a sentence"
    assert sorted(sentences.keys() - PLACEHOLDERS.keys()) == [], "the catalogue has sentences that nobody says"
    assert {key: placeholders(text) for key, text in sentences.items()} == {
        key: set(names) for key, names in PLACEHOLDERS.items()
    }


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_test_of_a_gyro_has_its_name_definition_and_formula(language: str) -> None:
    tests = catalogue(language).tables["tests"]
    assert tests.keys() == UNITS.keys()
    for words in tests.values():
        assert all(words[part] for part in ("name", "definition", "formula"))


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_label_source_and_phrase_of_the_metrology_has_its_words(language: str) -> None:
    tables = catalogue(language).tables
    assert sorted(spoken.labels() - tables["words"].keys()) == [], "columns, traces or axes without a word"
    assert sorted(spoken.sources() - tables["sources"].keys()) == [], "sources of uncertainty without a word"
    assert spoken.reasons()
    unknown = [told for told in spoken.origins() | spoken.reasons() if not known_phrase(told)]
    assert unknown == [], "origins of figures that no phrase of the catalogue fits"


def known_phrase(told: str) -> bool:
    return catalogue("ru").phrase(told) != told


def test_phrases_are_translated_with_their_numbers_and_a_strange_one_is_kept() -> None:
    russian = catalogue("ru")
    assert russian.phrase("±2.5″ stated, uniform") == "указано ±2,5″, равномерное распределение"
    assert russian.phrase("certificate A.1-2.3, k = 2") == "свидетельство A.1-2.3, k = 2"
    assert russian.phrase("latitude: assumed; tilt: certificate, k = 2") == (
        "широта: принято; наклон оси: свидетельство, k = 2"
    )
    assert russian.phrase("the moon") == "the moon"
    assert catalogue("en").phrase("certificate, k = 2") == "certificate, k = 2"


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_unit_of_a_test_is_printed_in_the_field_s_own_way(language: str) -> None:
    words = catalogue(language)
    for unit in {*UNITS.values(), *spoken.units()}:
        assert "deg" not in words.unit(unit)
        assert "sqrt" not in words.unit(unit)
        if language == "ru":
            assert not any("a" <= letter <= "z" for letter in words.unit(unit)), unit


def test_units_read_as_a_passport_has_them() -> None:
    english, russian = catalogue("en"), catalogue("ru")
    assert russian.unit("mV/(deg/s)") == "мВ/(°/с)"
    assert russian.unit("(deg/h)/(degC/min)") == "(°/ч)/(°C/мин)"
    assert russian.unit("deg/sqrt(h)") == "°/√ч"
    assert english.unit("deg/sqrt(h)") == "°/√h"
    assert russian.unit("ppm") == "млн⁻¹"
    assert russian.unit("1") == ""


def test_the_fields_of_a_russian_passport_are_named_as_it_names_them() -> None:
    russian = catalogue("ru")
    named = [russian.test(name).name for name in ("scale_factor", "bias", "nonlinearity", "bandwidth")]
    assert named == ["Масштабный коэффициент", "Смещение нуля", "Нелинейность", "Полоса пропускания"]
    stages = ("первичный", "после вибрации", "после удара", "после перегрузки", "после термоцикла", "финальный")
    assert tuple(russian.tables["stages"].values()) == stages
    assert [russian.stage(told) for told in ("After shock", "after_shock", "после удара", "mine")] == [
        *["после удара"] * 3,
        "mine",
    ]
    assert catalogue("en").stage("финальный") == "final"


def test_a_sentence_has_its_numbers_in_its_language() -> None:
    told = message("of_these_cycles", cycles=5, low=0.01234, high=12345.6)
    assert "Over 5 turn-ons" in catalogue("en").said(told)
    assert "0.0123 to 12346" in catalogue("en").said(told)
    assert "от 0,0123 до 12346" in catalogue("ru").said(told)
    certificate = message("certificate_expired", role="rate_table", model="A.1", date="2026-01-31")
    assert "поворотный стол (A.1)" in catalogue("ru").said(certificate)
    assert "12,8 °/ч" in catalogue("ru").said(message("earth_taken_off", rate_deg_per_h=12.8))


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_sentence_can_be_said_with_any_values(language: str) -> None:
    for key, names in PLACEHOLDERS.items():
        for value in (0.0, -1e-9, float("nan"), 1e12, "{x} <b>"):
            assert "{}" not in catalogue(language).said(Message(key, dict.fromkeys(names, value)))


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0"), (40.0, "40"), (0.0996, "0.0996"), (3600.0, "3600"), (2.5, "2.5"), (-12.345, "−12.3"), (1e-5, "1.00")],
)
def test_a_number_in_a_sentence_is_short(value: float, shown: str) -> None:
    assert short(value).startswith(shown)


def test_what_the_catalogue_does_not_know_is_shown_as_it_is() -> None:
    assert catalogue("ru").word("new_column") == "new column"
    assert catalogue("ru").test("new_test").name == "new test"
    assert catalogue("en").word("power_pole", "roles") == "power pole"


def test_another_language_is_refused_by_name() -> None:
    with pytest.raises(UsageError, match="--lang de: the report is written in en or ru"):
        catalogue("de")


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_pdf_s_font_has_every_letter_of_the_catalogue(language: str) -> None:
    letters = FT2Font(f"{mpl.get_data_path()}/fonts/ttf/DejaVuSans.ttf").get_charmap()
    assert {letter for text in texts(language).values() for letter in text if ord(letter) not in letters} == set()
