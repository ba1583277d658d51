"""How far what is measured is from what it may be."""

import pytest

from benchctl.bench import load_bench
from benchctl.dashboard.data.details import BenchLimit, bench_of, limits_of, measured
from tests.benchctl.recordings import made


@pytest.mark.parametrize(
    ("low", "high", "value", "margin"),
    [
        (-100.0, 100.0, 0.0, 1.0),
        (-100.0, 100.0, 75.0, 0.25),
        (-100.0, 100.0, -110.0, -0.1),
        (-40.0, 80.0, 20.0, 1.0),
        (None, 4.0, 3.0, 0.25),
        (None, 4.0, -9.0, 1.0),
        (2.0, None, 1.0, -0.5),
        (None, 0.0, -0.5, 0.5),
    ],
)
def test_the_margin_is_what_is_left_of_the_way(
    low: float | None, high: float | None, value: float, margin: float
) -> None:
    assert BenchLimit("gyro_v", low, high).margin(value) == pytest.approx(margin)


def test_what_is_not_known_has_no_margin() -> None:
    told = BenchLimit("gyro_v", None, 4.0).held_against(None)
    assert told == {"quantity": "gyro_v", "unit": "V", "low": None, "high": 4.0, "value": None, "margin": None}


def test_quantities_of_bench_toml_are_found_among_the_values() -> None:
    values = {"air_c": 25.0, "setpoint_c": 20.0, "rate_dps": 7.0, "gyro_c": None}
    assert measured(values, "setpoint_error_c") == 5.0
    assert measured(values, "encoder_dps") == measured(values, "rate_dps") == 7.0
    assert measured(values, "gyro_c") is measured(values, "power_percent") is None
    assert measured({"air_c": 1.0}, "setpoint_error_c") is None


def test_a_recording_without_a_bench_or_with_a_spoilt_one_has_no_limits() -> None:
    assert bench_of(made.meta()) is None
    assert bench_of(made.meta(provenance={"bench_toml": "name = 3"})) is None
    assert limits_of(None) == []
    bench = bench_of(made.meta(provenance={"bench_toml": load_bench("simulated").text}))
    assert [limit.quantity for limit in limits_of(bench)] == ["rate_dps", "acceleration_dps2", "air_c"]
