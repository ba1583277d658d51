"""The rate from the encoder: gain, noise, delay, the half samples that get lost, and several runs at once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_coeffs

from benchctl.signals.rate import (
    NARROW,
    choose_smoother,
    derivative_of,
    derivative_weights,
    differentiator,
    edges_hz,
    filtered,
    filtered_each,
    gain_error,
    half_of,
    unwrap_deg,
)
from benchctl_instruments.errors import UsageError
from tests.benchctl.signals.turning import RATE_HZ

LENGTHS = (1, 2, 40, 700, 3000)


def test_weights_agree_with_those_of_another_program() -> None:
    theirs = savgol_coeffs(21, 4, deriv=1, use="dot")
    assert derivative_weights(10, 4) == pytest.approx(theirs, abs=1e-12)


@given(
    coefficients=st.lists(st.floats(-5, 5), min_size=5, max_size=5),
    delay=st.floats(-0.02, 0.02),
)
def test_a_quartic_is_differentiated_exactly_at_any_delay(coefficients: list[float], delay: float) -> None:
    t = np.arange(200) / 500
    angle = np.asarray(np.polynomial.polynomial.polyval(t, coefficients), dtype=np.float64)
    smoother = choose_smoother(500.0, 1.0, 1e-6)
    rate, where = derivative_of(angle, smoother, delay_s=delay)
    slope = np.polynomial.polynomial.polyval(t[where] - delay, np.polynomial.polynomial.polyder(coefficients))
    assert rate == pytest.approx(slope, abs=1e-7)


def test_the_stated_gain_error_is_that_of_a_sine() -> None:
    t = np.arange(5000) / 500
    smoother = choose_smoother(500.0, 1.0, 1e-3)
    rate, where = derivative_of(np.sin(2 * np.pi * t) / (2 * np.pi), smoother)
    true = np.cos(2 * np.pi * t[where])
    assert abs((rate @ true) / (true @ true) - 1) == pytest.approx(smoother.gain_error, rel=1e-3)


def test_the_stated_noise_is_that_of_white_angles() -> None:
    rng = np.random.default_rng(1)
    smoother = choose_smoother(500.0, 2.0, 1e-5)
    rate, _ = derivative_of(1e-3 * rng.standard_normal(200_000), smoother)
    assert rate.std() == pytest.approx(1e-3 * smoother.noise_gain, rel=0.02)


def test_a_coarser_encoder_gets_a_quieter_smoother() -> None:
    fine, coarse = choose_smoother(100.0, 2.0, 1e-7), choose_smoother(100.0, 2.0, 1e-2)
    assert coarse.noise_gain < fine.noise_gain
    assert fine.gain_error < coarse.gain_error


def test_motion_beyond_half_the_sampling_rate_is_refused() -> None:
    with pytest.raises(UsageError, match="needs more than 160 samples"):
        choose_smoother(100.0, 80.0, 1e-6)


def test_a_rate_stands_at_its_stamp_where_a_difference_would_be_half_a_sample_late() -> None:
    fs, f = 100.0, 0.5
    t = np.arange(2000) / fs
    angle = np.sin(2 * np.pi * f * t)
    true = 2 * np.pi * f * np.cos(2 * np.pi * f * t)
    slope = -((2 * np.pi * f) ** 2) * np.sin(2 * np.pi * f * t)

    def lateness(rate: np.ndarray, at: slice) -> float:
        return float(-(rate - true[at]) @ slope[at] / (slope[at] @ slope[at]))

    rate, where = derivative_of(angle, choose_smoother(fs, f, 1e-6))
    assert lateness(rate, where) == pytest.approx(0.0, abs=1e-6)
    assert lateness(np.diff(angle) * fs, slice(1, None)) == pytest.approx(0.5 / fs, rel=1e-3)


@pytest.mark.parametrize("delay", [0.0, 0.0012, 0.005, 0.0123, -0.0071])
def test_a_delay_moves_the_rate_by_itself_and_not_by_samples(delay: float) -> None:
    t = np.arange(3000) / 100
    rate, where = derivative_of(np.sin(3 * t), choose_smoother(100.0, 0.5, 1e-6), delay_s=delay)
    assert rate == pytest.approx(3 * np.cos(3 * (t[where] - delay)), abs=1e-4)


@pytest.mark.parametrize("period", [360.0, 120.0])
def test_unwrapping_takes_out_the_jumps(period: float) -> None:
    true = np.linspace(350, 1500, 400)
    assert np.diff(unwrap_deg(true % period, period)) == pytest.approx(np.diff(true))


def test_the_gain_error_grows_with_the_frequency() -> None:
    errors = [gain_error(20, 4, f, 500.0) for f in (0.0, 1.0, 3.0, 9.0)]
    assert errors[0] == 0.0
    assert errors == sorted(errors)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_each_stretch_comes_out_as_by_itself(order: int) -> None:
    chance = np.random.default_rng(order)
    kernel = differentiator(RATE_HZ, *edges_hz(NARROW, RATE_HZ), order)
    stretches = [1e3 * place + np.cumsum(chance.standard_normal(size)) for place, size in enumerate(LENGTHS)]
    together = filtered_each(stretches, kernel)
    for values, one in zip(stretches, together, strict=True):
        alone = filtered(values, kernel)
        assert one.shape == values.shape
        np.testing.assert_allclose(one, alone, rtol=1e-9, atol=1e-9 * np.abs(alone).max() + 1e-10)


def test_no_stretch_leaks_into_the_next() -> None:
    kernel = differentiator(RATE_HZ, *edges_hz(NARROW, RATE_HZ), 1)
    still, turning = np.full(500, 77.0), 50.0 * np.arange(500) / RATE_HZ
    first, second, third = filtered_each([still, turning, still], kernel)
    assert np.abs(first).max() < 1e-7
    assert np.abs(third).max() < 1e-7
    inner = slice(half_of(RATE_HZ), -half_of(RATE_HZ))
    np.testing.assert_allclose(second[inner], 50.0, rtol=1e-6)
