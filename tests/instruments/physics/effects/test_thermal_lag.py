from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effect_contract.behaviour import at
from benchctl_instruments.physics.effects.thermal_lag import ThermalLag

TAU_S = 300.0
RATE = 0.02


def ramp(from_s: float, to_s: float, interval_s: float = 0.5) -> Signals:
    """A thermistor that leaves 20 °C at 0 s, with 0.02 °C/s."""
    times = np.arange(from_s, to_s, interval_s)
    return replace(at(times, interval_s), coil_c=20.0 + RATE * times)


def behind(times: FloatArray) -> FloatArray:
    """The coil of such a ramp in closed form."""
    lagging: FloatArray = 20.0 + RATE * (times - TAU_S * -np.expm1(-times / TAU_S))
    return lagging


@pytest.mark.parametrize("interval_s", [0.01, 1.0, 250.0])
def test_a_ramp_is_followed_as_its_closed_form_says_at_any_interval(interval_s: float) -> None:
    done = ThermalLag(tau_s=TAU_S).apply(ramp(0.0, 2000.0, interval_s))
    np.testing.assert_allclose(done.coil_c, behind(done.time_s), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(done.coil_rate_c_per_s, RATE * -np.expm1(-done.time_s / TAU_S), rtol=0.0, atol=1e-11)


def test_the_rate_is_the_derivative_of_the_coil() -> None:
    signals = at(np.arange(0.0, 16.0, 1e-3), 1e-3)
    done = ThermalLag(tau_s=2.0).apply(signals)
    np.testing.assert_allclose(np.gradient(done.coil_c, done.time_s)[1:-1], done.coil_rate_c_per_s[1:-1], atol=1e-5)


def test_over_a_gap_the_temperature_runs_straight() -> None:
    lag = ThermalLag(tau_s=TAU_S)
    before = lag.apply(ramp(0.0, 500.0))
    after = lag.apply(replace(ramp(1200.0, 1300.0), memory=before.memory))
    np.testing.assert_allclose(after.coil_c, behind(after.time_s), rtol=0.0, atol=1e-9)


def test_a_gap_in_which_the_temperature_stood_warms_the_coil_through() -> None:
    lag = ThermalLag(tau_s=TAU_S)
    before = lag.apply(ramp(0.0, 500.0))
    stood = replace(ramp(501.0, 502.0), coil_c=np.full(2, 20.0 + RATE * 499.5), memory=before.memory)
    held = lag.apply(stood)
    later = replace(stood, time_s=stood.time_s + 20.0 * TAU_S, memory=held.memory)
    np.testing.assert_allclose(lag.apply(later).coil_c, stood.coil_c, rtol=0.0, atol=1e-6)
    assert held.coil_c[0] < stood.coil_c[0] - 3.0


def test_other_temperatures_stay_as_they_are() -> None:
    signals = ramp(0.0, 100.0)
    done = ThermalLag(tau_s=TAU_S).apply(signals)
    assert done.housing_c is signals.housing_c
    assert done.thermistor_c is signals.thermistor_c
