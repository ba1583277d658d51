"""Line against sine on tables of static points, made and real."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.calibration.static_points_fit import fit_static_points
from instruments.errors import UsageError
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
