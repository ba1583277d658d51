from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.gyro import (
    GyroParameters,
    bias_v,
    earth_rate_dps,
    low_pass,
    sine_output_v,
    white_deviation_v,
)

GYRO = GyroParameters()


@pytest.mark.parametrize(
    ("rate", "indicated"),
    [(40, 39.79), (60, 59.28), (100, 96.69), (150, 138.96), (160, 146.65), (175, 157.62), (200, 174.29)],
)
def test_the_sine_law_indicates_what_was_worked_out_for_the_published_scale(rate: float, indicated: float) -> None:
    # domain reference, table A2, S = 0.00448 rad per deg/s
    gyro = replace(GYRO, S_rad_per_dps=0.00448)
    volts = sine_output_v(gyro, np.array([rate, -rate], np.float64), np.array([20.0, 20.0]))
    np.testing.assert_allclose(volts / gyro.K0_v_per_dps, [indicated, -indicated], atol=0.006)


def test_a_non_reciprocal_phase_gives_an_offset_and_an_even_term() -> None:
    gyro = replace(GYRO, phi_nr_rad=0.01)
    rate = 150.0
    up, rest, down = sine_output_v(gyro, np.array([rate, 0.0, -rate]), np.full(3, 20.0)) / gyro.K0_v_per_dps
    assert rest == pytest.approx(0.01 / 0.0045, rel=1e-4)
    # even part of sin(Sω + φ)/S: sin φ·(cos Sω − 1)/S
    assert 0.5 * (up + down) - rest == pytest.approx(math.sin(0.01) * (math.cos(0.0045 * rate) - 1.0) / 0.0045)


def test_response_and_bias_follow_their_polynomials_in_temperature() -> None:
    hot = np.array([85.0])
    ratio = sine_output_v(GYRO, np.array([10.0]), hot) / sine_output_v(GYRO, np.array([10.0]), np.array([20.0]))
    assert ratio[0] == pytest.approx(1.0 - 1.315e-4 * 65.0 + 2.066e-6 * 65.0**2, rel=1e-12)
    assert bias_v(GYRO, hot)[0] == pytest.approx(0.012 + 2e-5 * 65.0 - 1.5e-7 * 65.0**2, rel=1e-12)


def test_the_earth_turns_counter_clockwise_in_the_north() -> None:
    assert earth_rate_dps(58.5) * 3600.0 == pytest.approx(12.82, abs=0.01)
    assert earth_rate_dps(-90.0) == pytest.approx(-15.041 / 3600.0)


def test_white_noise_of_the_default_gyro_at_500_hz_is_about_half_a_millivolt() -> None:
    # N = 0.03 deg/√h is 0.03/60 (deg/s)/√Hz
    assert white_deviation_v(GYRO, 500.0) == pytest.approx(0.05 * 0.03 / 60.0 * math.sqrt(500.0))


@pytest.mark.parametrize(("order", "delay_s"), [(1, 1.0 / (2e2 * math.pi)), (2, math.sqrt(2.0) / (2e2 * math.pi))])
def test_the_low_pass_lags_behind_a_ramp_by_exactly_its_delay(order: int, delay_s: float) -> None:
    interval_s = 5e-4
    electronics = low_pass(100.0, order, interval_s)
    times = np.arange(2000, dtype=np.float64) * interval_s
    ramp = 3.0 * times
    smoothed, _ = electronics(ramp, electronics.at_rest(0.0))
    np.testing.assert_allclose(smoothed[-100:], 3.0 * (times[-100:] - delay_s), atol=1e-10)


def test_the_low_pass_of_a_ramp_from_rest_is_the_closed_form_at_every_sample() -> None:
    # 1/(s²(s²/ω² + √2 s/ω + 1)): t − √2/ω + e^(−ωt/√2)·√2/ω·cos(ωt/√2)
    omega, interval_s = 2.0 * math.pi * 200.0, 5e-4
    electronics = low_pass(200.0, 2, interval_s)
    times = np.arange(60, dtype=np.float64) * interval_s
    smoothed, _ = electronics(times, electronics.at_rest(0.0))
    damped = omega * times / math.sqrt(2.0)
    expected = times - math.sqrt(2.0) / omega * (1.0 - np.exp(-damped) * np.cos(damped))
    np.testing.assert_allclose(smoothed, expected, atol=1e-14)


def test_a_filter_at_rest_stays_at_its_level() -> None:
    electronics = low_pass(200.0, 2, 5e-4)
    smoothed, _ = electronics(np.full(500, 1.25), electronics.at_rest(1.25))
    np.testing.assert_allclose(smoothed, 1.25, rtol=1e-12)


@pytest.mark.parametrize("wrong", [{"S_rad_per_dps": 0.0}, {"cutoff_hz": 0.0}, {"order": 3}])
def test_an_impossible_gyro_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        GyroParameters(**wrong)  # type: ignore[arg-type]
