"""Numbers with units in bench.toml, limits.toml and model files: converted by what their keys state, or refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.bench import Bench, bench_of_text, template
from benchctl.metrology.limit_file import limits_of_text
from benchctl.model_file import read_model
from benchctl.toml_file import toml_in_units
from benchctl_instruments.errors import UsageError


def bench_with(old: str, new: str) -> Bench:
    assert old in template()
    return bench_of_text(template().replace(old, new), "bench.toml")


def test_a_bench_may_state_its_numbers_in_other_units() -> None:
    bench = bench_with("silence_s = 10.0", 'silence_s = "0.5 min"')
    assert bench.limits.silence_s == 30.0
    assert bench_with("hottest_c = 85.0", 'hottest_c = "185 degF"').limits.hottest_c == 85.0
    assert bench_with("ramp_c_per_min = 2.0", 'ramp_c_per_min = "120 K/h"').limits.ramp_c_per_min == 2.0
    assert bench_with("rate_dps = 300.0", 'rate_dps = "50 rpm"').limits.rate_dps == 300.0
    assert bench_with("sample_rate_hz = 500.0", 'sample_rate_hz = "0.5 kHz"').digitizer.sample_rate_hz == 500.0


def test_tables_that_are_checked_elsewhere_may_do_so_too() -> None:
    bench = bench_with("# [effects.thermal_lag]\n# tau_s = 312.0", '[effects.thermal_lag]\ntau_s = "5.2 min"')
    assert bench.effects == {"thermal_lag": {"tau_s": 312.0}}


def test_an_interlocks_limits_are_in_the_unit_of_what_is_measured() -> None:
    table = '[[interlocks]]\nquantity = "gyro_c"\nabove = "343.15 K"\nhysteresis = "2 K"\nfor_s = "0.5 min"\n[site]'
    interlock = bench_with("[site]", table).interlocks[0]
    assert (interlock.above, interlock.hysteresis, interlock.for_s) == (70.0, 2.0, 30.0)
    error = bench_with("[site]", '[[interlocks]]\nquantity = "setpoint_error_c"\nabove = "2 K"\n[site]').interlocks[0]
    assert error.above == 2.0
    assert (
        bench_with("[site]", '[[interlocks]]\nquantity = "air_c"\nabove = "176 °F"\n[site]').interlocks[0].above == 80.0
    )


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("silence_s = 10.0", 'silence_s = "10 m"', "bench.toml, line 23: limits.silence_s: expected a number in s"),
        ("hottest_c = 85.0", 'hottest_c = "85 C"', "limits.hottest_c: expected a number in degC"),
        ("[site]", '[[interlocks]]\nquantity = "gyro_c"\nabove = "7 V"\n[site]', "expected a number in degC"),
        (
            "[site]",
            '[[interlocks]]\nquantity = "gyro_v"\nhysteresis = "1 K"\nabove = 1\n[site]',
            "expected a number in V",
        ),
    ],
)
def test_a_unit_that_will_not_do_is_named_with_its_line(old: str, new: str, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        bench_with(old, new)
    assert str(caught.value).startswith("bench.toml, line ")
    assert says in str(caught.value)


def test_what_a_certificate_states_of_the_air_may_be_no_temperature_so_only_degrees_celsius_will_do() -> None:
    table = '[chamber]\ncertificate = { air_c = "0.3 °C" }\n'
    certificate = bench_with("[chamber]\n", table).chamber.certificate
    assert certificate is not None
    assert certificate.air_c == 0.3
    with pytest.raises(UsageError, match="is not clear from its name"):
        bench_with("[chamber]\n", table.replace("°C", "K"))


def test_the_settings_of_limits_may_do_so_too() -> None:
    text = '[settings]\nlow_rate_dps = "0.5 rad/s"\n[limits.bias]\nhigh = 5\nunit = "deg/h"\n'
    assert limits_of_text(text, Path("limits.toml")).settings.low_rate_dps == 28.64788975654116
    with pytest.raises(UsageError, match=r"limits.toml, line 2: settings.low_rate_dps: expected a number in deg/s"):
        limits_of_text(text.replace("rad/s", "rad"), Path("limits.toml"))


def test_a_model_file_may_do_so_too(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text('[effects.thermal_lag]\ntau_s = "5.2min"\n')
    assert read_model(path).effects == {"thermal_lag": {"tau_s": 312.0}}


def test_other_strings_are_left_as_they_are_and_lists_are_looked_into() -> None:
    text = 'name = "5 min"\n[a]\nb_s = ["1 min", 2.0]\naddress = "tcp://10.0.0.1:502"\n'
    assert toml_in_units(text, "x") == {
        "name": "5 min",
        "a": {"b_s": [60.0, 2.0], "address": "tcp://10.0.0.1:502"},
    }
