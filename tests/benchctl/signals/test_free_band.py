"""Motion beyond the band in which angles make a rate: what is then compared."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.signals.free_band import Band, band_of
from tests.benchctl.signals.turning import SWEPT_HZ, sweeping


def test_a_band_passes_what_is_slow_and_nothing_else() -> None:
    time_s, _, _ = sweeping(0.0)
    band = Band(stretches=(slice(0, 30000), slice(30000, time_s.size)), sample_rate_hz=SWEPT_HZ, stop_hz=4.0)
    slow, fast = np.sin(2 * np.pi * 1.5 * time_s), np.sin(2 * np.pi * 4.5 * time_s)
    away = np.ones(band.rows.size, np.bool_)
    for part in band.kept_stretches:
        away[part.start : part.start + band.reach] = away[part.stop - band.reach : part.stop] = False
    np.testing.assert_allclose(band.slow(slow)[away], slow[band.rows][away], atol=2e-3)
    np.testing.assert_allclose(band.slow(fast)[away], 0.0, atol=2e-3)
    assert [part.stop - part.start for part in band.kept_stretches] == [-(-30000 // band.every)] * 2


def test_the_band_ends_before_a_line_that_only_one_of_the_two_has() -> None:
    time_s, angle, rate = sweeping(0.0)
    chance = np.random.default_rng(1)
    rate = rate + 5.0 * chance.standard_normal(time_s.size)
    noise = 0.3 * chance.standard_normal(time_s.size)
    alone = 0.5 * np.sin(2 * np.pi * 5.3 * time_s)
    whole = (slice(0, time_s.size),)
    assert band_of(whole, SWEPT_HZ, angle, rate, 0.02 * (rate + noise)).stop_hz > 15.0
    assert 4.0 < band_of(whole, SWEPT_HZ, angle, rate, 0.02 * (rate + noise + alone)).stop_hz < 5.3


def test_a_scale_factor_that_changes_meanwhile_is_no_noise_of_a_band() -> None:
    time_s, angle, rate = sweeping(0.0)
    chance = np.random.default_rng(2)
    rate = rate + 5.0 * chance.standard_normal(time_s.size)
    noise = 0.3 * chance.standard_normal(time_s.size)
    whole = (slice(0, time_s.size),)
    ageing = band_of(whole, SWEPT_HZ, angle, rate, 0.02 * ((1.0 + 0.01 * time_s / 600.0) * rate + noise))
    white = 0.02 * 0.3 * np.sqrt(2.0 * 0.8 * ageing.stop_hz / SWEPT_HZ)  # its share of the band
    assert ageing.noise == pytest.approx(white, rel=0.15)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("of_rate", [False, True])
def test_what_depends_on_the_heading_does_not_end_the_band_in_which_it_is_looked_for(of_rate: bool, order: int) -> None:
    time_s, angle, rate = sweeping(0.0)
    chance = np.random.default_rng(3)
    rate = rate + 5.0 * chance.standard_normal(time_s.size)
    noise = 0.3 * chance.standard_normal(time_s.size)
    whole = (slice(0, time_s.size),)
    without = band_of(whole, SWEPT_HZ, angle, rate, 0.02 * (rate + noise))
    heading = np.cos(order * np.radians(angle)) * (0.02 * rate if of_rate else 2.0)
    beside = band_of(whole, SWEPT_HZ, angle, rate, 0.02 * (rate + noise + heading))
    assert beside.stop_hz == pytest.approx(without.stop_hz, rel=0.05)
    assert beside.noise == pytest.approx(without.noise, rel=0.05)
