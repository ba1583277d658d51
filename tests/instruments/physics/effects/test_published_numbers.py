"""Effects of one line each, against numbers that somebody else has computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effect_contract.behaviour import at
from benchctl_instruments.physics.effects.angular_acceleration import AngularAcceleration
from benchctl_instruments.physics.effects.bias_temperature_rate import BiasTemperatureRate
from benchctl_instruments.physics.effects.dead_zone import DeadZone
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.fringe_ambiguity import FringeAmbiguity
from benchctl_instruments.physics.effects.heading_dependent_bias import HeadingDependentBias
from benchctl_instruments.physics.effects.rate_nonlinearity import RateNonlinearity
from benchctl_instruments.physics.effects.rate_squared import RateSquared
from benchctl_instruments.physics.effects.scale_ageing import ScaleAgeing
from benchctl_instruments.physics.effects.scale_asymmetry import ScaleAsymmetry
from benchctl_instruments.physics.effects.scale_rate_temperature_coupling import ScaleRateTemperatureCoupling
from benchctl_instruments.physics.effects.scale_temperature import ScaleTemperature
from benchctl_instruments.physics.effects.warm_up import WarmUp

S = 0.00448


def volts(effect: PhysicalEffect, **arrays: list[float] | FloatArray) -> FloatArray:
    """The output of an effect where it was 1 V, for arrays that are given."""
    given = {name: np.asarray(value, np.float64) for name, value in arrays.items()}
    size = max(value.size for value in given.values())
    signals = replace(at(np.arange(float(size)), 1.0), output_v=np.ones(size))
    return effect.apply(replace(signals, **given)).output_v  # type: ignore[arg-type]  # fields that are arrays


@pytest.mark.parametrize(("rate", "deficit"), [(40.0, 0.53), (60.0, 1.20), (100.0, 3.31), (150.0, 7.36), (175.0, 9.93)])
def test_the_scale_factor_of_an_interferometer_falls_as_its_sine_does(rate: float, deficit: float) -> None:
    sine = RateNonlinearity(c2=-(S**2) / 6.0, c4=S**4 / 120.0, range_dps=rate)
    assert 100.0 * (1.0 - volts(sine, sensed_rate_dps=[rate])[0]) == pytest.approx(deficit, abs=0.011)
    assert f"at {rate:.0f} °/s" in sine.says()
    assert "% lower than near zero" in sine.says()


def test_the_published_polynomial_of_the_temperature_has_its_published_values() -> None:
    published = ScaleTemperature(a1=1.315e-4, a2=-2.066e-6, T0_c=0.0)
    done = volts(published, coil_c=[-50.0, -20.0, 0.0, 25.0, 31.8, 85.0])
    np.testing.assert_allclose(100.0 * (done - 1.0), [-1.174, -0.346, 0.0, 0.200, 0.209, -0.375], atol=6e-4)


def test_a_sagnac_phase_that_grows_with_temperature_leaves_what_does_not_separate() -> None:
    per_kelvin = 131e-6
    coupling = ScaleRateTemperatureCoupling(coefficient=-(0.0045**2) / 3.0 * per_kelvin)
    done = volts(coupling, coil_c=[80.0, 20.0, 80.0], sensed_rate_dps=[150.0, 150.0, 0.0])
    np.testing.assert_allclose(done, [1.0 - 0.0012, 1.0, 1.0], atol=1e-5)


def test_a_nonreciprocal_phase_of_a_hundredth_adds_half_a_degree_a_second_at_150() -> None:
    k0 = 0.05
    squared = RateSquared(v_per_dps2=-0.5 * k0 * 0.0045 * 0.01)
    np.testing.assert_allclose((volts(squared, sensed_rate_dps=[150.0, -150.0]) - 1.0) / k0, -0.506, atol=1e-3)


def test_the_two_directions_have_scale_factors_a_fraction_apart() -> None:
    done = volts(ScaleAsymmetry(fraction=1e-3), sensed_rate_dps=[20.0, -20.0, 0.0])
    np.testing.assert_allclose(done, [1.0005, 0.9995, 1.0], rtol=1e-12)


def test_folding_the_rate_is_what_the_sine_does() -> None:
    rate = np.linspace(-3000.0, 3000.0, 1001)
    signals = replace(at(np.arange(1001.0), 1.0), sensed_rate_dps=rate)
    folded = FringeAmbiguity(fold_dps=np.pi / (2.0 * S)).apply(signals).sensed_rate_dps
    assert np.pi / (2.0 * S) == pytest.approx(351.0, abs=0.5)
    np.testing.assert_allclose(np.sin(S * folded), np.sin(S * rate), rtol=0.0, atol=1e-12)
    assert np.abs(folded).max() <= np.pi / (2.0 * S)


def test_a_dead_zone_is_flat_and_then_shifted() -> None:
    signals = replace(at(np.arange(5.0), 1.0), sensed_rate_dps=np.array([-3.0, -0.5, 0.0, 0.5, 3.0]))
    done = DeadZone(half_width_dps=1.0).apply(signals).sensed_rate_dps
    np.testing.assert_array_equal(done, [-2.0, 0.0, 0.0, 0.0, 2.0])


def test_a_delay_of_a_millisecond_is_an_acceleration_sensitivity_of_minus_a_thousandth_of_the_scale() -> None:
    peak = 150.0 * np.pi  # of 150 deg/s at 0.5 Hz
    done = volts(AngularAcceleration(v_per_dps2=-1e-3), acceleration_dps2=[peak])
    assert 1.0 - done[0] == pytest.approx(0.47, abs=0.002)


def test_the_bias_of_a_changing_temperature_has_its_sign() -> None:
    done = volts(BiasTemperatureRate(v_per_c_per_s=0.02), coil_rate_c_per_s=[0.1, 0.0, -0.1])
    np.testing.assert_allclose(done, [1.002, 1.0, 0.998], rtol=1e-12)


@pytest.mark.parametrize(("order", "opposite"), [(1.0, 0.99), (2.0, 1.01)])
def test_the_bias_of_a_heading_returns_with_every_period_of_its_order(order: float, opposite: float) -> None:
    field = HeadingDependentBias(amplitude_v=0.01, phase_deg=30.0, order=order)
    np.testing.assert_allclose(volts(field, angle_deg=[30.0, 210.0, -330.0]), [1.01, opposite, 1.01], rtol=1e-12)


def test_time_counts_in_hours_and_from_the_start_of_the_recording() -> None:
    ageing = ScaleAgeing(per_hour=-0.01, start_s=100.0)
    np.testing.assert_allclose(volts(ageing, time_s=[100.0, 3700.0]), [1.0, 0.99], rtol=1e-12)
    warming = WarmUp(amplitude_v=0.5, tau_s=60.0, start_s=100.0)
    np.testing.assert_allclose(volts(warming, time_s=[100.0, 160.0]), [1.5, 1.0 + 0.5 / np.e], rtol=1e-12)
