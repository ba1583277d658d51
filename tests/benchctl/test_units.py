"""Units as people write them, and what they are to each other."""

import time

import pytest

from benchctl.units import exact_factor, factor_between, spelled


@pytest.mark.parametrize(
    ("unit", "other", "factor"),
    [
        ("ppm", "%", 1e-4),
        ("ppm", "percent", 1e-4),
        ("%", "ppm", 1e4),
        ("ppm", "1", 1e-6),
        ("ppm/degC", "%/degC", 1e-4),
        ("ppm/degC", "ppm/K", 1.0),
        ("deg/h", "deg/s", 1 / 3600),
        ("deg/h", "°/h", 1.0),
        ("deg/h", "rad/s", 4.84813681109536e-06),
        ("deg/s", "rpm", 1 / 6),
        ("deg/h", "mdeg/s", 1 / 3.6),
        ("mV/(deg/s)", "V/(deg/s)", 1e-3),
        ("mV/(deg/s)", "mV/(°/s)", 1.0),
        ("mV/(deg/s)", "V/(rad/s)", 0.0572957795),
        ("deg/sqrt(h)", "deg/s/sqrt(Hz)", 1 / 60),
        ("deg/sqrt(h)", "deg/h/sqrt(Hz)", 60.0),
        ("deg/sqrt(h)", "(deg/h)*sqrt(h)", 1.0),
        ("(deg/h)/sqrt(h)", "(deg/s)/sqrt(s)", 1 / 3600 / 60),
        ("(deg/h)/h", "deg/h^2", 1.0),
        ("(deg/h)/h", "deg/h**2", 1.0),
        ("(deg/h)/degC", "(deg/s)/K", 1 / 3600),
        ("(deg/h)/(degC/min)", "(deg/h)/(K/s)", 60.0),
        ("arcsec", "mrad", 1e3 * 4.84813681109536e-06),
        ("arcsec", "arcmin", 1 / 60),
        ("mrad", "deg", 0.0572957795),
        ("ms", "s", 1e-3),
        ("s", "min", 1 / 60),
        ("Hz", "kHz", 1e-3),
        ("Hz", "1/s", 1.0),
    ],
)
def test_a_limit_may_be_in_any_unit_of_the_kind(unit: str, other: str, factor: float) -> None:
    assert factor_between(unit, other) == pytest.approx(factor, rel=1e-9)
    assert factor_between(other, unit) == pytest.approx(1.0 / factor, rel=1e-9)


@pytest.mark.parametrize(
    ("unit", "other"),
    [
        ("deg/h", "deg"),
        ("deg/h", "xyz"),
        ("deg/h", ""),
        ("deg/h", "deg/h**(1"),
        ("deg/h", "deg//h"),
        ("deg/h", "2*deg/h"),
        ("deg/h", "0*deg/h"),
        ("deg/h", "deg/h; import os"),
        ("deg/h", "__import__('os')"),
        ("mV/(deg/s)", "LSB/(deg/s)"),
        ("mV/(deg/s)", "mV/deg"),
        ("ms", "Hz"),
        ("ppm", "ppm/degC"),
        # an angle is no bare number: a limit in rad/s would be wrong by 2π as one in Hz
        ("Hz", "rad/s"),
        ("Hz", "rpm"),
        ("deg/h", "Hz"),
        ("ppm", "mrad"),
        ("mrad", "ppm"),
        ("mV/(deg/s)", "mV*s"),
        ("deg/sqrt(h)", "1/sqrt(h)"),
    ],
)
def test_a_unit_of_something_else_is_refused(unit: str, other: str) -> None:
    with pytest.raises(ValueError, match=r"^the unit .* is none of what is measured in"):
        factor_between(unit, other)


@pytest.mark.parametrize("unit", ["9**9**9**9", "s^9^9^9^9^9^9", "(" * 5000, "a" * 100_000, "s" + "*s" * 9999])
def test_a_unit_that_would_take_long_to_work_out_is_refused_at_once(unit: str) -> None:
    factor_between("s", "ms")  # the registry is made once
    begun = time.process_time()
    with pytest.raises(ValueError, match="none of what is measured in s") as caught:
        factor_between("s", unit)
    assert time.process_time() - begun < 0.5
    assert len(str(caught.value)) < 500


def test_factors_are_exact_where_no_pi_is_in_them() -> None:
    assert exact_factor("ms", "h") * 3_600_000 == 1
    assert exact_factor("arcsec", "deg") * 3600 == 1
    assert exact_factor("degF/min", "K/min") * 9 == 5


@pytest.mark.parametrize(
    ("written", "letters"),
    [
        ("°/s²", "deg/s^2"),
        ("°C/min", "degC/min"),
        (" ″ ", "arcsec"),
        ("µs", "us"),
        ("mV·s⁻¹", "mV*s^-1"),
        ("%", "percent"),
    ],
)
def test_signs_are_spelled_in_letters(written: str, letters: str) -> None:
    assert spelled(written) == letters


def test_the_fields_own_word_for_a_rate_is_known() -> None:
    assert factor_between("dps", "deg/s") == 1.0
    assert factor_between("mV/dps", "V/(deg/s)") == 1e-3
