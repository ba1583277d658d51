"""Scale factor and its figures, by gyros whose law is one at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.metrology.observations import Settings
from benchctl.plan import ConstantRate, Static
from tests.benchctl.metrology.altered import results
from tests.benchctl.metrology.made_unit import EARTH_DPS, LATITUDE_DEG
from tests.benchctl.metrology.short_plans import IDEAL, QUIET, soak, sweep

STRAIGHT = replace(IDEAL, white_v_per_sqrt_hz=1e-9)
EARTH_VERTICAL_DPS = EARTH_DPS * np.sin(np.deg2rad(LATITUDE_DEG))


def test_a_straight_gyro_has_its_slope_and_nothing_else() -> None:
    found = results([soak(), *sweep()], IDEAL)
    assert found["scale_factor"].value == pytest.approx(50.0, rel=2e-6)
    for name in ("nonlinearity", "nonlinearity_reading", "asymmetry"):
        assert found[name].uncertainty is not None
        assert found[name].uncertainty.says.key == "not_told_from_zero"
        assert found[name].uncertainty.expanded >= found[name].value > 0.0  # type: ignore[operator]
    assert (found["input_range"].value, found["input_range"].bound) == (pytest.approx(100.0), "at least")


def test_nonlinearity_is_the_largest_misfit_over_the_largest_output() -> None:
    """Of U = K·(ω − c·ω³), where the Earth's rate is part of ω: by the moments of the rates."""
    cubic, earth = 3e-7, EARTH_VERTICAL_DPS
    rates = np.array([0.0, 20, -20, 40, -40, 60, -60, 80, -80, 100, -100])
    slope = 1.0 - cubic * (np.sum(rates**4) / np.sum(rates**2) + 3.0 * earth**2)
    intercept = earth - cubic * (3.0 * earth * np.mean(rates**2) + earth**3)
    volts = rates + earth - cubic * (rates + earth) ** 3
    expected = 1e6 * np.max(np.abs(volts - slope * rates - intercept)) / np.max(np.abs(volts - intercept))
    found = results([soak(), *sweep()], replace(STRAIGHT, cubic_per_dps2=cubic))
    assert found["nonlinearity"].value == pytest.approx(expected, rel=1e-5)
    assert found["scale_factor"].value == pytest.approx(50.0 * slope, rel=1e-7)


def test_nonlinearity_of_reading_refers_to_the_line_at_low_rates() -> None:
    cubic = 3e-7
    low = np.array([0.0, 20, -20, 40, -40])
    slope = 1.0 - cubic * np.sum(low**4) / np.sum(low**2)
    expected = 100.0 * abs((1.0 - cubic * 100.0**2) / slope - 1.0)
    found = results([soak(), *sweep()], replace(STRAIGHT, cubic_per_dps2=cubic))["nonlinearity_reading"]
    assert found.value == pytest.approx(expected, rel=1e-3)
    assert [note.values for note in found.notes if note.key == "line_up_to"] == [{"limit_dps": 40.0}]


def test_asymmetry_is_the_difference_of_both_directions_over_their_mean() -> None:
    found = results([soak(), *sweep()], replace(STRAIGHT, asymmetry=400e-6))["asymmetry"]
    assert found.value == pytest.approx(400.0, rel=1e-5)
    lopsided = results([soak(), *sweep()], replace(STRAIGHT, asymmetry=-400e-6))["asymmetry"]
    assert lopsided.value == pytest.approx(400.0, rel=1e-5)


def test_the_input_range_ends_where_the_error_of_reading_passes_the_limit() -> None:
    unit = replace(STRAIGHT, cubic_per_dps2=1e-5)  # 1 % of reading at 33 deg/s beyond the line
    found = results([soak(), *sweep()], unit, settings=Settings(low_rate_dps=20.0))["input_range"]
    slope = 1.0 - 1e-5 * 20.0**2  # of the line through 0 and ±20
    errors = [100.0 * ((1.0 - 1e-5 * rate**2) / slope - 1.0) for rate in (20.0, 40.0)]
    assert errors[1] == pytest.approx(-1.2, abs=0.01)
    assert found.value == pytest.approx(20.0 + 20.0 * 1.0 / abs(errors[1]), rel=2e-4)
    assert found.bound == ""


def test_an_input_range_that_ends_below_the_first_rate_is_only_known_to_be_less() -> None:
    unit = replace(STRAIGHT, cubic_per_dps2=1e-5)
    settings = Settings(low_rate_dps=40.0, linearity_percent=0.01)
    found = results([soak(), *sweep()], unit, settings=settings)["input_range"]
    assert (found.value, found.bound) == (pytest.approx(20.0), "at most")


def test_a_curved_gyro_has_the_slope_of_its_set_point() -> None:
    """Also the thermometer's error belongs to a scale factor that changes with temperature."""
    steps = [soak(), *sweep(), soak(60.0), *sweep(50.0)]
    found = results(steps, replace(STRAIGHT, scale_per_c=-150e-6))["scale_factor"]
    assert found.uncertainty is not None
    thermometer = {one.source: one.standard for one in found.uncertainty.contributors}["thermometer"]
    assert thermometer == pytest.approx(0.1 * 150e-6 * 50.0, rel=0.02)
    still = results([soak(), *sweep()], STRAIGHT)["scale_factor"]
    assert still.uncertainty is not None
    assert {one.source: one.standard for one in still.uncertainty.contributors}["thermometer"] == 0.0


def test_every_figure_names_the_steps_and_the_temperature_that_it_comes_from() -> None:
    found = results([soak(), *sweep(), soak(60.0), *sweep(50.0)], QUIET)["scale_factor"]
    assert found.steps == tuple(range(2, 14))
    assert found.temperature_c == pytest.approx(20.0, abs=0.01)
    rates = next(column for column in found.table if column.name == "rate")
    assert len(rates.values) == 11


@pytest.mark.parametrize(
    ("steps", "name", "why"),
    [
        ([soak(), Static(duration_s=60.0)], "scale_factor", "needs_rates"),
        ([soak(), Static(duration_s=60.0)], "input_range", "needs_rates"),
        ([soak(), *sweep(100.0, 1)], "nonlinearity_reading", "needs_rates"),  # no three rates up to 40 deg/s
        ([soak(), *sweep(5.0)], "input_range", "needs_rates"),  # none that is high enough
        ([soak(), *sweep(100.0, 1)], "asymmetry", "needs_both_directions"),
        (
            [soak(), *[ConstantRate(rate_dps=rate, duration_s=36.0) for rate in (50, 100, 50, -50, -60, -50)]],
            "asymmetry",
            "needs_rates",  # two rates in both directions are no sweep
        ),
        (
            [
                soak(),
                Static(duration_s=60.0),
                *[ConstantRate(rate_dps=rate, duration_s=36.0) for rate in (50, 100, 50, -50, -60, -50)],
            ],
            "asymmetry",
            "needs_both_directions",  # 50 deg/s twice is one rate
        ),
    ],
)
def test_what_a_sweep_does_not_hold_is_refused(steps: list, name: str, why: str) -> None:
    found = results(steps, QUIET)[name]
    assert found.value is None
    assert found.refused is not None
    assert found.refused.key == why
