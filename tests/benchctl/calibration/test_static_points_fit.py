"""Line against sine on tables of static points, made and real."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.calibration.static_points_fit import fit_static_points
from benchctl_instruments.errors import UsageError
from tests.shared import SHARED, needs_shared

RATES = np.linspace(-200, 200, 21)


def test_a_sine_is_found_and_covered_by_its_interval() -> None:
    inside = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        points = 0.1 - 0.057 / 0.0043 * np.sin(0.0043 * RATES) + 0.02 * rng.standard_normal(RATES.size)
        low, high = fit_static_points(RATES, points).all_points.S_ci95
        inside += low < 0.0043 < high
    assert 90 <= inside <= 99


def test_a_point_at_rest_that_is_off_is_seen() -> None:
    points = 0.1 - 0.057 / 0.0043 * np.sin(0.0043 * RATES)
    points[RATES == 0] += 0.03
    result = fit_static_points(RATES, points)
    assert result.rest_points == 1
    assert result.rest_offset_v == pytest.approx(0.03, abs=1e-6)
    assert result.rotating.sine.rms_dps < 1e-6
    assert result.all_points.sine.rms_dps > 0.1


def test_the_residual_of_the_line_is_odd_and_cubic() -> None:
    result = fit_static_points(RATES, 0.05 / 0.0045 * np.sin(0.0045 * RATES)).all_points
    assert result.residual_line_dps == pytest.approx(-result.residual_line_dps[::-1], abs=1e-9)
    assert result.residual_sine_dps == pytest.approx(np.zeros(RATES.size), abs=1e-6)
    assert result.line.largest_percent_fs > 3


WIDE = np.linspace(-400, 400, 41)


@pytest.mark.parametrize("low_v", [-10.9, -9.5])
def test_rates_beyond_a_limit_of_the_output_are_not_fitted(low_v: float) -> None:
    inside = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        law = 0.1 - 0.057 / 0.0043 * np.sin(0.0043 * WIDE)
        points = np.clip(law, low_v, 11.2) + 0.02 * rng.standard_normal(WIDE.size)
        result = fit_static_points(WIDE, points)
        clipped = (law < low_v) | (law > 11.2)
        assert result.follows_to_dps == pytest.approx(np.abs(WIDE[clipped]).min() - 20.0)
        assert result.beyond == int((np.abs(WIDE) > result.follows_to_dps).sum())
        assert f"Beyond {result.follows_to_dps:g} °/s" in result.says
        low, high = result.rotating.S_ci95
        inside += low < 0.0043 < high
    assert inside >= 16


def test_nothing_is_left_out_where_the_law_holds_throughout() -> None:
    for seed in range(60):
        rng = np.random.default_rng(seed)
        points = 0.1 - 0.057 / 0.0043 * np.sin(0.0043 * RATES) + 0.02 * rng.standard_normal(RATES.size)
        points[rng.integers(3, 18)] += 0.5  # one point that is off is no end of the law
        assert fit_static_points(RATES, points).beyond == 0


def test_too_few_rates_are_refused() -> None:
    with pytest.raises(UsageError, match="expected at least 5"):
        fit_static_points(np.array([-10.0, 0.0, 10.0]), np.array([1.0, 0.0, -1.0]))


def test_points_that_are_not_finite_are_refused() -> None:
    with pytest.raises(UsageError, match="finite"):
        fit_static_points(RATES, np.full(RATES.size, np.nan))


@needs_shared("data/vg910")
def test_a_real_vg910_is_an_open_loop_sine() -> None:
    table = np.genfromtxt(
        SHARED / "data/vg910/unit1_static_points.csv", delimiter=",", skip_header=1, usecols=(0, 3, 4, 5)
    )
    widest = table[table[:, 0] == 49]
    result = fit_static_points(widest[:, 1], widest[:, 2], widest[:, 3])
    assert result.rotating.line.largest_percent_fs == pytest.approx(4, abs=0.3)
    assert result.rotating.sine.largest_percent_fs == pytest.approx(0.35, abs=0.15)
    every = fit_static_points(table[:, 1], table[:, 2], table[:, 3])
    low, high = every.rotating.S_ci95
    assert 0.0042 < low < 0.0043 < high < 0.0044
    assert every.rotating.K0_v_per_dps == pytest.approx(-0.0574, abs=1e-4)
    assert every.rest_offset_dps == pytest.approx(0.5, abs=0.15)
    assert every.rest_std_v == pytest.approx(0.0037, abs=1e-4)
    assert 0.01 < every.rotating_std_v < 0.08


@needs_shared("data/vg910")
def test_a_real_vg910_beyond_its_range_has_the_scale_factor_of_its_range() -> None:
    table = np.genfromtxt(
        SHARED / "data/vg910/unit1_static_points_to_400.csv", delimiter=",", skip_header=1, usecols=(3, 4, 5)
    )
    result = fit_static_points(table[:, 0], table[:, 1], table[:, 2])
    assert result.follows_to_dps == 200.0
    assert result.beyond == 6
    low, high = result.rotating.S_ci95
    assert 0.0042 < low < result.rotating.S_rad_per_dps < high < 0.0044


@needs_shared("data/vg910")
def test_a_real_mems_gyro_is_fitted_between_its_limits() -> None:
    table = np.genfromtxt(
        SHARED / "data/vg910/crs03_static_points.csv", delimiter=",", skip_header=1, usecols=(3, 4, 5)
    )
    result = fit_static_points(table[:, 0], table[:, 1], table[:, 2])
    assert result.follows_to_dps in (100.0, 120.0)
    assert result.rotating.sine.rms_dps * abs(result.rotating.K0_v_per_dps) < 2.5e-3
