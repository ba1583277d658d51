import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from benchctl.reports import text


@pytest.mark.parametrize(
    ("value", "uncertainty", "unit", "expected"),
    [
        (0.0500001, 8.8e-7, "V/(°/s)", "(50.00010\u00a0±\u00a00.00088)\u00a0×\u00a010⁻³\u00a0V/(°/s)"),
        (3.02e-6, 1.2e-8, "", "(3.020\u00a0±\u00a00.012)\u00a0×\u00a010⁻⁶"),
        (-1.5e-7, 6.6e-8, "V", "(−150\u00a0±\u00a066)\u00a0×\u00a010⁻⁹\u00a0V"),
        (12.3456, 0.0996, "", "12.35\u00a0±\u00a00.10"),
        (-9.0, 0.4, "″", "(−9.00\u00a0±\u00a00.40)″"),
        (-6.8e-8, 6.21e-7, "", "(−70\u00a0±\u00a0620)\u00a0×\u00a010⁻⁹"),
        (-68.0, 2100.0, "", "−100\u00a0±\u00a02100"),
        (0.0, 2e-5, "V", "(0\u00a0±\u00a020)\u00a0×\u00a010⁻⁶\u00a0V"),
        (0.0119896, 1.8e-4, "V", "(0.01199\u00a0±\u00a00.00018)\u00a0V"),
        (1.149, 0.996, "°/h", "(1.1\u00a0±\u00a01.0)\u00a0°/h"),
        (0.0500000232, 5.5e-6, "V/(°/s)", "(50.0000\u00a0±\u00a00.0055)\u00a0×\u00a010⁻³\u00a0V/(°/s)"),
    ],
)
def test_a_value_is_rounded_to_two_digits_of_its_uncertainty(value, uncertainty, unit, expected):
    assert text.with_uncertainty(value, uncertainty, unit).replace(" ± ", "\u00a0±\u00a0") == expected


@pytest.mark.parametrize("uncertainty", [None, 0.0, math.nan, math.inf])
def test_a_value_without_an_uncertainty_claims_none(uncertainty):
    assert text.with_uncertainty(0.0497, uncertainty, "V") == "0.0497000\u00a0V"


@given(
    value=st.floats(min_value=-1e6, max_value=1e6),
    uncertainty=st.floats(min_value=1e-9, max_value=1e3),
)
def test_what_is_printed_is_the_value_to_within_a_rounding(value, uncertainty):
    assume(abs(value) < 1e8 * uncertainty)
    printed, _, rest = text.with_uncertainty(value, uncertainty).partition(" ± ")
    power = 10.0 ** read_exponent(rest)
    stated = float(rest.partition(")")[0])
    assert float(printed.lstrip("(").replace("−", "-")) * power == pytest.approx(value, abs=0.051 * uncertainty + 1e-15)
    assert stated * power == pytest.approx(uncertainty, rel=0.051)


def read_exponent(printed: str) -> int:
    digits = printed.partition("×\u00a010")[2]
    return int(digits.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 0)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (9.96, "10"),
        (0.0461, "0.046"),
        (1e-4, "1.0\u00a0×\u00a010⁻⁴"),
        (9.99999e-7, "1.0\u00a0×\u00a010⁻⁶"),
        (0.0, "0.0"),
        (None, "–"),
        (math.nan, "–"),
    ],
)
def test_a_number_keeps_its_significant_digits(value, expected):
    assert text.number(value, 2) == expected


def test_a_percentage_that_is_not_known_is_a_dash_without_a_sign():
    assert text.percent(None) == "–"
    assert text.percent(8.584) == "8.6\u00a0%"


def test_an_interval_shares_one_power_of_ten():
    assert text.interval(4.4e-7, 1.22e-6) == "[440, 1220]\u00a0×\u00a010⁻⁹"


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        (12.2, "12\u00a0s"),
        (200, "3\u00a0min 20\u00a0s"),
        (118740, "32\u00a0h 59\u00a0min"),
        (3599.7, "1\u00a0h 00\u00a0min"),
    ],
)
def test_durations_read_like_a_clock(seconds, expected):
    assert text.duration(seconds) == expected


def test_a_span_of_one_number_is_that_number():
    assert text.span(20.0, 20.01, "°C") == "20\u00a0°C"
    assert text.span(-40.0, 60.0, "°C") == "−40 to 60\u00a0°C"


def test_a_rounded_nothing_has_no_sign():
    assert text.plain(-0.01) == "0"
    assert text.plain(math.nan, "°C") == "–"


def test_thousands_stand_apart():
    assert text.count(4245000) == "4\u202f245\u202f000"


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("V/(deg/s)", "V/(°/s)"),
        ("°C^-2", "°C⁻²"),
        ("V/°C^1", "V/°C"),
        ("1/degC**2", "1/°C²"),
        ("arcsec", "″"),
        ("V", "V"),
        ("1", ""),
        ("degree s-1", "°/s"),
        ("degree s-2", "°/s²"),
        ("V (degree/s)-2", "V (°/s)⁻²"),
        ("degC-1", "°C⁻¹"),
    ],
)
def test_units_are_printed_in_symbols(unit, expected):
    assert text.unit_text(unit) == expected
