"""What switching on does to a gyro, and what a gyro mounted across feels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chain import Signals, gyro_baseline, run_chain
from benchctl_instruments.physics.effects.bias_drift import BiasDrift
from benchctl_instruments.physics.effects.scale_warm_up import ScaleWarmUp
from benchctl_instruments.physics.effects.warm_up import WarmUp
from benchctl_instruments.physics.gyro import EARTH_DPS, GyroParameters, earth_rate_dps, horizontal_earth_rate_dps
from benchctl_instruments.physics.mounting import mounted_across
from benchctl_instruments.physics.turn_on import turned_on, warming_up_since

STRAIGHT = GyroParameters(order=0, S_rad_per_dps=1e-9)


def signals(rate_dps: float, angle_deg: float, scans: int = 3) -> Signals:
    def constant(value: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.full(scans, value)

    return Signals(
        interval_s=0.002,
        time_s=np.arange(scans) * 0.002,
        angle_deg=constant(angle_deg),
        rate_dps=constant(rate_dps),
        acceleration_dps2=constant(0.0),
        housing_c=constant(20.0),
        coil_c=constant(20.0),
        sensed_rate_dps=constant(rate_dps),
        output_v=constant(0.0),
        encoder_deg=constant(angle_deg),
        thermistor_c=constant(20.0),
        coil_rate_c_per_s=constant(0.0),
    )


def test_bias_and_scale_factor_scatter_as_stated_about_the_gyros_own() -> None:
    gyro = GyroParameters(turn_on_bias_v=2e-4, turn_on_scale_ppm=150.0)
    made = [turned_on(gyro, 7, times) for times in range(1, 4001)]
    bias = np.array([one.U0_v for one in made]) - gyro.U0_v
    scale_ppm = 1e6 * (np.array([one.K0_v_per_dps for one in made]) / gyro.K0_v_per_dps - 1.0)
    for draws, deviation in ((bias, 2e-4), (scale_ppm, 150.0)):
        assert draws.std() == pytest.approx(deviation, rel=0.05)
        assert abs(draws.mean()) < 4.0 * deviation / math.sqrt(draws.size)
    assert abs(np.corrcoef(bias, scale_ppm)[0, 1]) < 0.06
    assert abs(np.corrcoef(bias[1:], bias[:-1])[0, 1]) < 0.06


def test_the_seed_and_the_count_say_how_it_comes_up_and_a_gyro_that_states_no_scatter_is_always_the_same() -> None:
    gyro = GyroParameters(turn_on_bias_v=2e-4, turn_on_scale_ppm=150.0)
    assert turned_on(gyro, 7, 2) == turned_on(gyro, 7, 2)
    assert len({turned_on(gyro, seed, times).U0_v for seed in (7, 8) for times in (1, 2, 3)}) == 6
    plain = GyroParameters()
    assert all(turned_on(plain, 7, times) == plain for times in range(1, 50))


@pytest.mark.parametrize("name", ["turn_on_bias_v", "turn_on_scale_ppm"])
def test_a_scatter_below_zero_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match=f"{name} is -1.0; give a standard deviation, 0 or more"):
        replace(STRAIGHT, **{name: -1.0})


def test_a_warm_up_begins_anew_and_nothing_else_does() -> None:
    effects = (WarmUp(amplitude_v=1e-3, tau_s=60.0), BiasDrift(v_per_hour=1e-6), ScaleWarmUp(fraction=1e-3, tau_s=60.0))
    warm, drift, scale = warming_up_since(effects, 500.0)
    assert warm == WarmUp(amplitude_v=1e-3, tau_s=60.0, start_s=500.0)
    assert drift is effects[1]
    assert scale == ScaleWarmUp(fraction=1e-3, tau_s=60.0, start_s=500.0)


def test_along_the_table_a_misaligned_axis_feels_the_cosine_and_across_it_the_sine() -> None:
    gyro, angle = replace(STRAIGHT, misalignment_mrad=2.0), math.sin(2e-3)
    along = gyro_baseline(gyro, 0.0, 0.002)
    felt = run_chain(signals(100.0, 0.0), along).sensed_rate_dps
    np.testing.assert_allclose(felt, 100.0 * math.sqrt(1.0 - angle**2), rtol=1e-12)
    for rate in (100.0, -100.0):
        felt = run_chain(signals(rate, 0.0), mounted_across(along, gyro.misalignment_mrad, 0.0)).sensed_rate_dps
        np.testing.assert_allclose(felt, rate * angle, rtol=1e-12)


@pytest.mark.parametrize(("angle_deg", "share"), [(0.0, 1.0), (90.0, 0.0), (180.0, -1.0), (360.0, 1.0), (60.0, 0.5)])
def test_across_it_feels_the_north_of_the_earths_rate_by_the_tables_angle(angle_deg: float, share: float) -> None:
    north = horizontal_earth_rate_dps(58.5)
    across = mounted_across(gyro_baseline(STRAIGHT, earth_rate_dps(58.5), 0.002), 0.0, north)
    np.testing.assert_allclose(run_chain(signals(70.0, angle_deg), across).sensed_rate_dps, share * north, atol=1e-15)
    assert math.hypot(north, earth_rate_dps(58.5)) == pytest.approx(EARTH_DPS)
