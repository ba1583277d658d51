"""Motion beyond the band in which angles make a rate: when that is so, and what is then compared."""

import numpy as np
import pytest

from benchctl.signals.free_band import Band, band_of, goes_beyond, wide_motion

RATE_HZ = 100.0


def sweeping(shaking_dps, hz=12.0):
    """Times, unwrapped angles and rates of a shaft that swings and shakes, over ten minutes."""
    time_s = np.arange(0.0, 600.0, 1 / RATE_HZ)
    angle = 60.0 / (2 * np.pi * 0.3) * np.sin(2 * np.pi * 0.3 * time_s)
    rate = 60.0 * np.cos(2 * np.pi * 0.3 * time_s)
    angle += shaking_dps / (2 * np.pi * hz) * np.sin(2 * np.pi * hz * time_s)
    rate += shaking_dps * np.cos(2 * np.pi * hz * time_s)
    return time_s, angle, rate


@pytest.mark.parametrize(("shaking_dps", "hz", "beyond"), [(0.0, 12.0, False), (20.0, 12.0, False), (20.0, 45.0, True)])
def test_only_what_no_filter_of_the_rate_passes_goes_beyond(shaking_dps, hz, beyond):
    _, angle, _ = sweeping(shaking_dps, hz)
    assert goes_beyond([angle], RATE_HZ) is beyond


def test_an_encoders_noise_does_not_make_rest_a_fast_motion():
    noise = 1e-3 * np.random.default_rng(0).standard_normal(30000)
    assert not goes_beyond([200.0 + noise], RATE_HZ)


def test_the_wide_filter_keeps_what_shakes_below_its_edge():
    _, angle, rate = sweeping(20.0)
    inside = slice(200, -200)
    np.testing.assert_allclose(wide_motion(angle, RATE_HZ).rate_dps[inside], rate[inside], atol=0.01)


def test_a_band_passes_what_is_slow_and_nothing_else():
    time_s, _, _ = sweeping(0.0)
    band = Band(stretches=(slice(0, 30000), slice(30000, time_s.size)), sample_rate_hz=RATE_HZ, stop_hz=4.0)
    slow, fast = np.sin(2 * np.pi * 1.5 * time_s), np.sin(2 * np.pi * 4.5 * time_s)
    away = np.ones(band.rows.size, np.bool_)
    for part in band.kept_stretches:
        away[part.start : part.start + band.reach] = away[part.stop - band.reach : part.stop] = False
    np.testing.assert_allclose(band.slow(slow)[away], slow[band.rows][away], atol=2e-3)
    np.testing.assert_allclose(band.slow(fast)[away], 0.0, atol=2e-3)
    assert [part.stop - part.start for part in band.kept_stretches] == [-(-30000 // band.every)] * 2


def test_the_band_ends_before_a_line_that_only_one_of_the_two_has():
    time_s, _, rate = sweeping(0.0)
    chance = np.random.default_rng(1)
    rate = rate + 5.0 * chance.standard_normal(time_s.size)
    noise = 0.3 * chance.standard_normal(time_s.size)
    alone = 0.5 * np.sin(2 * np.pi * 5.3 * time_s)
    whole = (slice(0, time_s.size),)
    assert band_of(whole, RATE_HZ, rate, 0.02 * (rate + noise)).stop_hz > 15.0
    assert 4.0 < band_of(whole, RATE_HZ, rate, 0.02 * (rate + noise + alone)).stop_hz < 5.3
