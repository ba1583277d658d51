"""Numbers of the report."""

from __future__ import annotations

import math

import pytest

from benchctl.metrology.result import Bound, Limit, Measured, Uncertainty, message
from benchctl.reports.acceptance.catalogue import catalogue, column, duration, exact, limits, stated

ENGLISH, RUSSIAN = catalogue("en"), catalogue("ru")


def measured(value: float | None, expanded: float | None, unit: str = "deg/h", bound: Bound = "") -> Measured:
    found = expanded is not None and Uncertainty(
        standard=expanded / 2,
        expanded=expanded,
        monte_carlo=expanded,
        contributors=(),
        says=message("gum_agrees", difference_percent=0.0),
    )
    return Measured(name="bias", unit=unit, value=value, uncertainty=found or None, bound=bound)


@pytest.mark.parametrize(
    ("value", "expanded", "shown"),
    [
        (49.70134, 0.00423, "(49.7013 ± 0.0042) °/h"),
        (-98.94, 4.21, "(−98.9 ± 4.2) °/h"),
        (0.0502, 0.00182, "(0.0502 ± 0.0018) °/h"),
        (12345.0, 432.0, "(12340 ± 430) °/h"),
        (0.996, 0.0996, "(1.00 ± 0.10) °/h"),
        (3.0, None, "3.00000 °/h"),
        (3.0, 0.0, "3.00000 °/h"),
        (None, None, "–"),
        (math.nan, 1.0, "–"),
        (2e-8, 1e-9, "(20.0 ± 1.0) × 10⁻⁹ °/h"),
    ],
)
def test_a_value_has_two_digits_of_its_uncertainty(value: float | None, expanded: float | None, shown: str) -> None:
    assert stated(measured(value, expanded), ENGLISH).replace("\u00a0", " ").startswith(shown)


def test_a_value_never_breaks_over_lines_and_has_the_language_s_decimal_sign() -> None:
    assert stated(measured(1.5, 0.25), RUSSIAN) == "(1,50\u00a0±\u00a00,25)\u00a0°/ч"
    assert stated(measured(1.5, 0.25), RUSSIAN, unit=False) == "1,50\u00a0±\u00a00,25"


def test_a_bound_has_its_sign() -> None:
    assert stated(measured(150.0, 0.02, "deg/s", "at least"), ENGLISH, unit=False) == "≥\u00a0150.000\u00a0±\u00a00.020"
    assert stated(measured(2.0, None, "deg/h", "at most"), ENGLISH).startswith("≤\u00a02")


@pytest.mark.parametrize(
    ("low", "high", "english", "russian"),
    [
        (49.5, 50.5, "49.5 to 50.5 ppm", "от 49,5 до 50,5 млн⁻¹"),
        (None, 300.0, "≤ 300 ppm", "≤ 300 млн⁻¹"),
        (-0.25, None, "≥ −0.25 ppm", "≥ −0,25 млн⁻¹"),
        (None, None, "–", "–"),
    ],
)
def test_a_limit_is_printed_as_it_was_written(low: float, high: float, english: str, russian: str) -> None:
    limit = Limit(low=low, high=high, unit="ppm")
    assert limits(limit, ENGLISH).replace("\u00a0", " ") == english
    assert limits(limit, RUSSIAN).replace("\u00a0", " ") == russian


def test_no_limit_is_a_dash() -> None:
    assert limits(None, ENGLISH) == "–"


def test_a_column_has_its_decimal_signs_under_each_other() -> None:
    assert column([-150.0, 0.0, 12.5], ENGLISH) == ["−150.0", "0.0", "12.5"]
    assert column([1.0, 2.0], RUSSIAN) == ["1", "2"]
    assert column([0.123456789, -2.0], RUSSIAN) == ["0,12346", "−2,00000"]
    assert column([100.0, math.nan], ENGLISH) == ["100", "–"]
    assert column([], ENGLISH) == []
    assert column([0.0, 0.0], ENGLISH) == ["0", "0"]
    assert column([1e-15, 6604.0], ENGLISH) == ["0", "6604"]


def test_a_column_of_many_decades_has_powers_of_ten() -> None:
    assert column([1e-9, 1e-3], ENGLISH) == ["1.000\u00a0×\u00a010⁻⁹", "0.001000"]
    assert column([2e9, 0.0], ENGLISH)[1] == "0"


@pytest.mark.parametrize(("seconds", "shown"), [(12.4, "12 с"), (200.0, "3 мин 20 с"), (5400.0, "1 ч 30 мин")])
def test_a_duration_is_in_the_language(seconds: float, shown: str) -> None:
    assert duration(seconds, RUSSIAN).replace("\u00a0", " ") == shown


def test_a_written_number_keeps_its_digits() -> None:
    assert exact(0.1, ENGLISH) == "0.1"
    assert exact(-1e-12, ENGLISH) == "−1\u00a0×\u00a010⁻¹²"
