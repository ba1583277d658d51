import numpy as np
import pytest

from benchctl.signals.motion import motion_of
from benchctl.signals.rate import half_of
from benchctl.signals.ripple import NO_RIPPLE, Ripple, ripple_of
from tests.benchctl.signals.turning import RATE_HZ, turning

COGGING_DEG = 2.0 / 3600.0


def test_cogging_beyond_the_pass_band_is_found_with_its_order_and_size() -> None:
    angles, _ = turning(cogging_deg=COGGING_DEG)
    ripple = ripple_of(angles, RATE_HZ)
    assert ripple.orders == (36,)
    assert np.hypot(ripple.cosines[0], ripple.sines[0]) == pytest.approx(COGGING_DEG, rel=0.05)


def test_a_table_that_turns_evenly_has_no_ripple() -> None:
    found = [ripple_of(turning(seed=seed)[0], RATE_HZ) for seed in range(20)]
    assert found == [NO_RIPPLE] * 20


def test_angles_without_any_noise_have_no_ripple() -> None:
    assert ripple_of([30.0 + 40.0 * np.arange(0.0, 8.0, 1.0 / RATE_HZ)], RATE_HZ) == NO_RIPPLE


def test_cogging_that_the_filters_pass_is_left_to_them() -> None:
    angles, _ = turning(cogging_deg=COGGING_DEG, rates_dps=(20.0, 60.0, -60.0))
    assert ripple_of(angles, RATE_HZ) == NO_RIPPLE


def test_rest_and_sudden_motion_hold_no_ripple() -> None:
    time_s = np.arange(0.0, 30.0, 1.0 / RATE_HZ)
    noise = 1e-4 * np.random.default_rng(3).standard_normal(time_s.size)
    assert ripple_of([noise, 50.0 * np.sin(9.0 * time_s) + noise, noise[:20]], RATE_HZ) == NO_RIPPLE


def test_with_the_ripple_the_rate_is_the_true_one() -> None:
    angles, rates = turning(cogging_deg=COGGING_DEG)
    ripple = ripple_of(angles, RATE_HZ)
    inner = slice(2 * half_of(RATE_HZ), -2 * half_of(RATE_HZ))
    for angle, true in zip(angles[1:], rates[1:], strict=True):
        turned = np.cos(np.radians(36.0 * angle))[inner]
        missed = [
            2.0 * abs(float(np.mean((motion_of(angle, RATE_HZ, one).rate_dps - true)[inner] * turned)))
            for one in (NO_RIPPLE, ripple)
        ]
        assert missed[1] < 6e-4
        if abs(np.mean(true)) > 140.0:
            assert missed[0] > 5.0 * missed[1]


def test_errors_of_fine_lines_are_no_motion_and_do_not_hide_it() -> None:
    angles, _ = turning(cogging_deg=COGGING_DEG)
    stated = [angle + 3.0 / 3600.0 * np.sin(np.radians(2048.0 * angle + 70.0)) for angle in angles]
    ripple = ripple_of(stated, RATE_HZ)
    assert ripple.orders == (36,)
    assert np.hypot(ripple.cosines[0], ripple.sines[0]) == pytest.approx(COGGING_DEG, rel=0.2)


def test_slope_and_bend_are_the_derivatives() -> None:
    ripple = Ripple(orders=(3, 36), cosines=(0.01, 0.002), sines=(-0.02, 0.001))
    angle = np.linspace(-100.0, 500.0, 200)
    near = 1e-4
    slope = (ripple.angle_deg(angle + near) - ripple.angle_deg(angle - near)) / (2 * near)
    bend = (ripple.slope(angle + near) - ripple.slope(angle - near)) / (2 * near)
    np.testing.assert_allclose(ripple.slope(angle), slope, atol=1e-8)
    np.testing.assert_allclose(ripple.bend_per_deg(angle), bend, atol=1e-8)


@pytest.mark.parametrize("lag_s", [-8e-4, 8e-4])
def test_cogging_that_the_servo_shifts_in_time_is_put_back_where_it_is_in_both_directions(lag_s: float) -> None:
    angles, rates = turning(rates_dps=(20.0, 200.0, 240.0, -200.0, -240.0))
    at = [angle - lag_s * np.gradient(angle) * RATE_HZ for angle in angles]
    stated = [a + COGGING_DEG * np.sin(np.radians(36.0 * b)) for a, b in zip(angles, at, strict=True)]
    ripple = ripple_of(stated, RATE_HZ)
    assert ripple.orders == (36,)
    assert ripple.lag_s == pytest.approx(lag_s, rel=0.1)
    inner = slice(2 * half_of(RATE_HZ), -2 * half_of(RATE_HZ))
    for angle, b, rate in zip(stated, at, rates, strict=True):
        phase = np.radians(36.0 * b)
        true = rate * (1.0 + np.radians(36.0) * COGGING_DEG * np.cos(phase))
        missed = (motion_of(angle, RATE_HZ, ripple).rate_dps - true)[inner]
        assert 2.0 * abs(float(np.mean(missed * np.sin(phase[inner])))) < 1e-3


def test_cogging_that_is_locked_to_the_angle_has_no_lag() -> None:
    assert ripple_of(turning(cogging_deg=COGGING_DEG)[0], RATE_HZ).lag_s == 0.0
