from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effect_contract.behaviour import at
from benchctl_instruments.physics.effects.thermal_hysteresis import ThermalHysteresis, play

temperatures = hnp.arrays(np.float64, st.integers(1, 90), elements=st.floats(-50.0, 80.0, width=32))


def one_by_one(x: FloatArray, half_width: float, start: float) -> list[float]:
    """The backlash operator as it is defined."""
    p, played = start, []
    for value in x.tolist():
        p = min(max(p, value - half_width), value + half_width)
        played.append(p)
    return played


@given(x=temperatures, half_width=st.floats(0.0, 40.0), start=st.floats(-60.0, 90.0))
@settings(max_examples=200, deadline=None)
def test_play_is_the_backlash_operator(x: FloatArray, half_width: float, start: float) -> None:
    np.testing.assert_array_equal(play(x, half_width, start), one_by_one(x, half_width, start))


@given(x=temperatures, half_width=st.floats(0.0, 40.0), repeats=st.integers(1, 5))
@settings(max_examples=50, deadline=None)
def test_play_knows_no_time(x: FloatArray, half_width: float, repeats: int) -> None:
    slower = play(np.repeat(x, repeats), half_width, float(x[0]))
    np.testing.assert_array_equal(slower[repeats - 1 :: repeats], play(x, half_width, float(x[0])))


def factors(*way_c: float) -> list[float]:
    """The factor on the scale factor, less 1, along a way of temperatures: ±4 °C of backlash, 10⁻³ a degree."""
    signals = at(np.arange(1.0, 1.0 + len(way_c)), 1.0)
    signals = replace(signals, coil_c=np.array(way_c), output_v=np.full(len(way_c), 2.0))
    changed = ThermalHysteresis(width_c=4.0, fraction_per_c=1e-3).apply(signals).output_v
    return [float(value) for value in np.round(changed / 2.0 - 1.0, 12)]


def test_heating_and_cooling_to_the_same_temperature_leave_two_scale_factors() -> None:
    begun, heated, hot, cooled, cold, heated_again = factors(20.0, 40.0, 60.0, 40.0, 0.0, 40.0)
    assert (begun, heated, cooled, heated_again) == (0.0, -0.004, 0.004, -0.004)
    assert (hot, cold) == (-0.004, 0.004)


def test_inside_the_backlash_the_scale_factor_follows_every_turn_of_the_temperature() -> None:
    assert factors(20.0, 21.0, 23.0, 17.0) == [0.0, -0.001, -0.003, 0.003]


def test_the_sentence_says_which_way_is_lower() -> None:
    assert "0.8 % lower after heating" in ThermalHysteresis(width_c=4.0, fraction_per_c=1e-3).says()
    assert "0.8 % higher after heating" in ThermalHysteresis(width_c=4.0, fraction_per_c=-1e-3).says()


@pytest.mark.slow
def test_an_hour_of_samples_takes_hundredths_of_a_second() -> None:
    x = 20.0 + np.random.default_rng(1).normal(size=400_000)
    begin = time.process_time()
    play(x, 1.0, 20.0)
    assert time.process_time() - begin < 0.1
