"""Numbers with units, as people write them: exact, and never guessed."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from benchctl.units import ENDINGS, quantity, unit_stated
from benchctl_instruments.errors import UsageError


@pytest.mark.parametrize(
    ("text", "name", "number"),
    [
        ("90min", "soak_s", 5400.0),
        ("90 min", "soak_s", 5400.0),
        ("2 h", "soak_s", 7200.0),
        ("5400", "soak_s", 5400.0),
        ("0.1 min", "soak_s", 6.0),
        ("5 µs", "tau_s", 5e-6),
        ("1 rad/s", "rate_dps", 57.29577951308232),
        ("36000 °/h", "rate_dps", 10.0),
        ("10 deg/s", "rate_dps", 10.0),
        ("10 °/s", "rate_dps", 10.0),
        ("10 dps", "rate_dps", 10.0),
        ("-1rpm", "rate_dps", -6.0),
        ("−1 rpm", "rate_dps", -6.0),
        ("1 rad/s^2", "acceleration_dps2", 57.29577951308232),
        ("1 °/s²", "acceleration_dps2", 1.0),
        ("1kHz", "rate_hz", 1000.0),
        ("1 mrad", "tilt_deg", 0.05729577951308232),
        ("36 arcsec", "tilt_deg", 0.01),
        ("0.01 deg", "encoder_arcsec", 36.0),
        ("0.1 %", "gain_ppm", 1000.0),
        ("0.1percent", "gain_ppm", 1000.0),
        ("500 ppm", "power_percent", 0.05),
        ("50 mV/(deg/s)", "K0_v_per_dps", 0.05),
        ("1 mV", "noise_v_rms", 0.001),
        ("20 °C", "room_c", 20.0),
        ("293.15 K", "room_c", 20.0),
        ("68 degF", "room_c", 20.0),
        ("-40 °F", "coldest_c", -40.0),
        ("0 K", "coldest_c", -273.15),
        ("1 K", "tolerance_c", 1.0),
        ("1 °C", "tolerance_c", 1.0),
        ("1.8 °F", "tolerance_c", 1.0),
        ("50 mK", "tolerance_c", 0.05),
        ("20 °C", "whatever_c", 20.0),
        ("1 K/min", "ramp_c_per_min", 1.0),
        ("1 °C/min", "ramp_c_per_min", 1.0),
        ("1.8 degF/min", "ramp_c_per_min", 1.0),
        ("60 K/h", "ramp_c_per_min", 1.0),
    ],
)
def test_a_number_with_a_unit_is_the_plain_number_in_the_unit_that_the_name_states(
    text: str, name: str, number: float
) -> None:
    assert quantity(text, unit_stated(name)) == number


@pytest.mark.parametrize(
    ("text", "name", "says"),
    [
        ("90m", "soak_s", "expected a number in s, bare or with a unit (s, min, h or ms), got '90m'"),
        ("1h30min", "soak_s", "expected a number in s"),
        ("1,5 s", "soak_s", "expected a number in s"),
        ("5 Hz", "rate_dps", "expected a number in deg/s"),
        ("1 rad/s", "rate_hz", "expected a number in Hz"),
        ("5 deg", "rate_dps", "expected a number in deg/s"),
        ("5 ppm", "tilt_deg", "expected a number in deg"),
        ("25C", "room_c", "(degC, K or degF), got '25C'"),
        ("25 °", "room_c", "expected a number in degC"),
        ("1 K/min", "room_c", "expected a number in degC"),
        ("1 K", "ramp_c_per_min", "expected a number in K/min"),
        ("5 K", "whatever_c", "whether it is a temperature or a difference is not clear from its name"),
        ("5 °F", "whatever_c", "in degC both are the same number"),
        ("5 s", "points", "expected a bare number, got '5 s': its name states no unit"),
        ("five", "points", "expected a bare number, got 'five'"),
        ("", "soak_s", "got ''"),
        ("s", "soak_s", "got 's'"),
        ("inf", "soak_s", "got 'inf'"),
        ("nan s", "soak_s", "got 'nan s'"),
        ("1e400", "soak_s", "got '1e400'"),
        ("1e305 s", "soak_s", "expected a number of ordinary size"),
        ("1e299 Yh", "soak_s", "expected a number in s"),
        ("5 __import__", "soak_s", "expected a number in s"),
        ("5 s" + " " * 200, "soak_s", "expected a number in s"),
    ],
)
def test_what_is_no_number_of_that_kind_is_refused_with_what_would_do(text: str, name: str, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        quantity(text, unit_stated(name))
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("soak_s", "s"),
        ("rate_dps", "deg/s"),
        ("acceleration_dps2", "deg/s^2"),
        ("ramp_c_per_min", "K/min"),
        ("set_points_c", "degC"),
        ("setpoint_c", "degC"),
        ("setpoint_error_c", "K"),
        ("air_c", "degC or K"),
        ("noise_v_rms", "V"),
        ("points", ""),
        ("rates", ""),
        ("s", ""),
    ],
)
def test_a_name_states_its_unit_by_its_ending(name: str, unit: str) -> None:
    assert unit_stated(name) == unit


def _number_or_refusal(text: str, name: str) -> float | str:
    try:
        return quantity(text, unit_stated(name))
    except UsageError as err:
        return str(err)


@given(st.text(max_size=120), st.sampled_from([*ENDINGS, "points"]))
def test_no_text_is_more_than_refused(text: str, name: str) -> None:
    answer = _number_or_refusal(text, f"x{name}")
    assert abs(answer) < float("inf") if isinstance(answer, float) else len(answer) < 500


@example("0/", "_c_per_min")
@given(st.from_regex(r"[0-9.eE+-]{0,9} ?[A-Za-z°/%*^() 0-9-]{0,14}", fullmatch=True), st.sampled_from(list(ENDINGS)))
def test_no_text_that_looks_like_a_quantity_is_more_than_refused(text: str, name: str) -> None:
    answer = _number_or_refusal(text, f"x{name}")
    assert abs(answer) < float("inf") if isinstance(answer, float) else "expected" in answer


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([*ENDINGS.values(), ""]))
def test_a_bare_number_is_itself(number: float, unit: str) -> None:
    assert quantity(repr(number), unit) == number


_UNITS = ["s", "ms", "deg", "mrad", "arcsec", "deg/s", "deg/s^2", "Hz", "V", "ppm", "percent", "K", "degC", "K/min"]


@given(st.floats(min_value=-1e9, max_value=1e9).filter(lambda x: x == 0 or abs(x) > 1e-9), st.sampled_from(_UNITS))
def test_a_number_in_the_stated_unit_is_itself_with_or_without_it(number: float, unit: str) -> None:
    assert quantity(f"{number!r} {unit}", unit) == number


_THERE_AND_BACK = [("min", "s"), ("kHz", "Hz"), ("arcsec", "deg"), ("mV", "V"), ("percent", "ppm"), ("rad/s", "deg/s")]


@given(st.integers(-(10**6), 10**6), st.sampled_from(_THERE_AND_BACK))
def test_there_and_back_again_is_the_same_number(number: int, units: tuple[str, str]) -> None:
    one, other = units
    assert quantity(f"{quantity(f'{number} {one}', other)!r} {other}", one) == pytest.approx(number, rel=1e-14)


@given(st.decimals(-200, 1000, places=3))
def test_temperatures_are_exact_to_the_last_digit(celsius: object) -> None:
    exact = Fraction(str(celsius))
    assert quantity(f"{celsius} °C", "degC") == float(exact)
    assert quantity(f"{celsius} K", "degC") == float(exact - Fraction("273.15"))
    assert quantity(f"{celsius} °F", "degC") == float((exact - 32) * 5 / 9)
    assert quantity(f"{celsius} °F", "K") == float(exact * 5 / 9)


def test_pint_is_imported_only_where_a_unit_is_met() -> None:
    code = (
        "import sys; from benchctl.units import quantity; quantity('5', 's'); quantity('20 K', 'degC');"
        "print('pint' in sys.modules); quantity('5 min', 's'); print('pint' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["False", "True"]
