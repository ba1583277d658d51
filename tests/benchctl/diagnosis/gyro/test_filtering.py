"""Filters of stretches as products in frequency, and splines between samples."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis.gyro.filtering import Filters, spline_at
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth

FloatArray = npt.NDArray[np.float64]

DT = 0.008
STRETCHES = (slice(0, 1500), slice(1600, 3100), slice(3100, 5100), slice(5100, 5101), slice(5101, 6601))
"""Three of one length and two others; nothing of 1500 to 1600."""

LOW_PASS = SensorBandwidth(cutoff_hz=8.0, order=2.0)


def wave(seed: int = 0) -> FloatArray:
    """Slow chance."""
    chance = np.random.default_rng(seed).standard_normal(6601 + 200)
    return np.convolve(chance, np.hanning(201) / 100.0, mode="valid")


def test_each_stretch_is_filtered_as_by_itself_whatever_its_length() -> None:
    values = wave()
    passed = Filters(STRETCHES, DT)(values, LOW_PASS)
    for rows in STRETCHES:
        alone = Filters([slice(0, rows.stop - rows.start)], DT)(values[rows], LOW_PASS)
        np.testing.assert_allclose(passed[rows], alone, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(passed[1500:1600], values[1500:1600])


@pytest.mark.parametrize("frequency_hz", [0.5, 4.0, 12.0])
def test_a_sine_comes_out_as_the_response_says(frequency_hz: float) -> None:
    time_s = DT * np.arange(3000)
    gain = complex(LOW_PASS.response(np.array([frequency_hz]))[0])
    passed = Filters([slice(0, 3000)], DT)(np.sin(2 * np.pi * frequency_hz * time_s), LOW_PASS)
    expected = np.imag(gain * np.exp(2j * np.pi * frequency_hz * time_s))
    inner = slice(300, -300)
    np.testing.assert_allclose(passed[inner], expected[inner], atol=2e-3 * abs(gain))


def test_what_was_kept_for_one_signal_is_not_taken_for_another() -> None:
    filters = Filters(STRETCHES, DT)
    signals = [wave(seed) for seed in range(6)]
    kinds = [SensorBandwidth(cutoff_hz=hz, order=1.0) for hz in (0.5, 5.0, 30.0)]
    for values in (*signals, *signals):
        before = values.copy()
        for kind in kinds:
            expected = Filters(STRETCHES, DT)(values, kind)
            np.testing.assert_array_equal(filters(values, kind), expected)
        np.testing.assert_array_equal(values, before)


def test_a_filter_that_does_nothing_gives_back_what_it_got() -> None:
    values = wave() + 100.0
    passed = Filters(STRETCHES, DT)(values, SensorBandwidth(cutoff_hz=1e9, order=1.0))
    np.testing.assert_allclose(passed, values, atol=1e-6)


def test_a_shift_of_slow_samples_is_exact_to_a_part_in_a_million() -> None:
    index = np.arange(2000, dtype=np.float64)
    shift = 0.37 + 1e-4 * index
    shifted = spline_at(np.sin(0.2 * index) + 0.5 * index, index + shift)
    expected = np.sin(0.2 * (index + shift)) + 0.5 * (index + shift)
    np.testing.assert_allclose(shifted[20:-20], expected[20:-20], atol=2e-6)


def test_too_few_samples_for_a_spline_stay_where_they_are() -> None:
    values = np.array([1.0, 4.0, 2.0])
    np.testing.assert_array_equal(spline_at(values, np.arange(3) + 0.5), values)
