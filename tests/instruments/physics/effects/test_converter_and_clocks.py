"""Converter, encoder lines and clocks: numbers worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl_instruments.physics.effect_contract.behaviour import sampled
from benchctl_instruments.physics.effects.adc_coarse import AdcCoarse
from benchctl_instruments.physics.effects.adc_nonlinearity import AdcNonlinearity
from benchctl_instruments.physics.effects.clock_drift import ClockDrift
from benchctl_instruments.physics.effects.encoder_interpolation import EncoderInterpolation
from benchctl_instruments.physics.effects.mains_pickup import MainsPickup
from benchctl_instruments.physics.effects.timing_offset import TimingOffset


def test_three_lost_bits_leave_steps_of_eight() -> None:
    coarse = AdcCoarse(bits_lost=3.0, adc_step_v=0.001)
    volts = np.array([-0.0041, -0.0039, 0.0, 0.0039, 0.0041, 0.0121])
    stairs = coarse.apply(replace(sampled(), output_v=volts)).output_v
    np.testing.assert_allclose(stairs, [-0.008, 0.0, 0.0, 0.0, 0.008, 0.016], atol=1e-15)


def test_the_converter_is_right_at_whole_and_half_periods_and_most_wrong_in_between() -> None:
    wave = AdcNonlinearity(inl_v=0.002, period_v=2.0)
    volts = np.array([-2.0, -1.0, 0.0, 0.5, 1.0, 1.5])
    error = wave.apply(replace(sampled(), output_v=volts)).output_v - volts
    np.testing.assert_allclose(error, [0.0, 0.0, 0.0, 0.002, 0.0, -0.002], atol=1e-15)


def test_one_arcsecond_at_nine_thousand_lines_is_four_percent_of_rate() -> None:
    encoder = EncoderInterpolation(amplitude_arcsec=1.0, lines_per_rev=9000.0)
    on_lines = np.arange(5, dtype=np.float64) * 360.0 / 9000.0
    np.testing.assert_allclose(encoder.error_deg(on_lines), 0.0, atol=1e-16)
    assert encoder.error_slope(on_lines).max() == pytest.approx(0.0436, rel=1e-3)
    assert encoder.error_deg(np.linspace(0.0, 1.0, 10_001)).max() == pytest.approx(1.0 / 3600.0, rel=1e-4)


def test_samples_with_an_offset_are_older_than_their_stamps() -> None:
    np.testing.assert_allclose(TimingOffset(offset_s=0.004).gyro_time_s(np.array([10.0, 20.0])), [9.996, 19.996])
    assert "older" in TimingOffset(offset_s=0.004).says()
    assert "younger" in TimingOffset(offset_s=-0.004).says()


def test_a_clock_that_drifts_is_in_step_at_the_start() -> None:
    drift = ClockDrift(ppm=50.0, start_s=100.0)
    np.testing.assert_allclose(drift.gyro_time_s(np.array([100.0, 700.0])), [100.0, 700.030], rtol=1e-15)
    assert "180 ms an hour further ahead" in drift.says()


def test_a_line_above_half_the_sample_rate_is_seen_at_its_alias() -> None:
    signals = replace(sampled(), output_v=np.zeros(sampled().time_s.size))
    above = MainsPickup(amplitude_v=0.001, frequency_hz=100.0, phase_deg=30.0).apply(signals).output_v
    # sampled at 125 Hz: 25 Hz, running backwards
    alias = MainsPickup(amplitude_v=0.001, frequency_hz=25.0, phase_deg=150.0).apply(signals).output_v
    np.testing.assert_allclose(above, alias, atol=1e-12)
