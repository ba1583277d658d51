"""Structures without a name: what each shape does to an output, and how one is known again by its name."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effects.making import make_effects
from benchctl_instruments.physics.structure_places import ACTS, OVER
from benchctl_instruments.physics.structure_shapes import SHAPES
from benchctl_instruments.physics.structures import structure, structure_named

ARRAYS = (
    "time_s",
    "angle_deg",
    "rate_dps",
    "acceleration_dps2",
    "housing_c",
    "coil_c",
    "sensed_rate_dps",
    "output_v",
    "encoder_deg",
    "thermistor_c",
    "coil_rate_c_per_s",
)


def signals(coil_c: list[float], output_v: float = 2.0) -> Signals:
    temp = np.array(coil_c)
    zeros = np.zeros_like(temp)
    return Signals(
        interval_s=0.01,
        time_s=0.01 * np.arange(temp.size),
        angle_deg=zeros,
        rate_dps=zeros,
        acceleration_dps2=zeros,
        housing_c=temp,
        coil_c=temp,
        sensed_rate_dps=zeros,
        output_v=np.full_like(temp, output_v),
        encoder_deg=zeros,
        thermistor_c=temp,
        coil_rate_c_per_s=zeros,
    )


def test_a_kink_of_the_scale_factor_changes_it_beyond_one_temperature_only() -> None:
    (kink,) = make_effects({"kink_of_scale_over_gyro_temp": {"at": 30.0, "above": -1e-3}})
    assert kink.apply(signals([20.0, 30.0, 40.0])).output_v.tolist() == pytest.approx([2.0, 2.0, 2.0 * (1.0 - 0.01)])
    assert kink.says() == "Above 30 °C of the coil's temperature the scale factor falls by 0.1 % per °C."


def test_a_step_of_the_bias_adds_the_same_voltage_at_any_rate() -> None:
    (step,) = make_effects({"step_of_bias_over_gyro_temp": {"at": 30.0, "change": 3e-3, "width": 0.1}})
    assert step.apply(signals([29.9, 30.1], output_v=-1.0)).output_v.tolist() == pytest.approx([-1.0, -0.997])
    assert step.says().startswith("Where the coil's temperature is above 30 °C the bias is 3 mV higher")


def test_a_power_begins_at_its_place_and_reaches_its_size_at_the_end_of_the_range() -> None:
    (root,) = make_effects(
        {"power_of_bias_over_gyro_temp": {"at": 30.0, "change": 4e-3, "exponent": 0.5, "high": 70.0}}
    )
    assert root.apply(signals([20.0, 30.0, 40.0, 70.0], 0.0)).output_v.tolist() == pytest.approx([0.0, 0.0, 2e-3, 4e-3])
    assert root.says().endswith("changes as the distance to the power of 0.5: at 70 °C it is 4 mV higher.")


@pytest.mark.parametrize("shape", SHAPES)
def test_the_name_of_a_structure_says_all_of_it(shape: str) -> None:
    for stage, over in itertools.product(ACTS, OVER):
        kind = structure_named(f"{shape}_of_{stage}_over_{over}")
        assert kind is not None
        assert (kind.shape, kind.acts_on, kind.over) == (shape, stage, over)
        made = kind.make(
            {name: 1e-3 if one.role == "size" else 5.0 + (name == "high") for name, one in kind.parameters.items()}
        )
        assert np.isfinite(made.apply(signals([20.0, 60.0])).output_v).all()
        assert made.says().endswith(".")


@pytest.mark.parametrize("stage", ["torque", "heat", "loss"])
def test_what_acts_on_another_part_is_refused_where_effects_of_a_gyro_are_made(stage: str) -> None:
    with pytest.raises(UsageError, match=f"'step_of_{stage}_over_time': there is no such effect"):
        make_effects({f"step_of_{stage}_over_time": {"at": 1.0, "change": 0.01, "width": 0.1}})


def test_a_jump_of_the_encoder_stays_in_the_angle_that_it_states() -> None:
    (jump,) = make_effects({"jump_of_encoder_over_time_2": {"at": 0.01, "change": 360.0}})
    assert jump.apply(signals([20.0, 20.0, 20.0])).encoder_deg.tolist() == pytest.approx([0.0, 0.1, 0.1])
    assert jump.says() == (
        "From 0.01 s of the time since the recording began on the angle that the encoder states is 360 ″ higher."
    )


def test_noise_grows_above_a_temperature_by_what_is_missing_to_it() -> None:
    (noise,) = make_effects(
        {"kink_of_noise_over_gyro_temp": {"at": 30.0, "above": 0.1}}, {"noise_v_rms": 1e-3, "seed": 4.0}
    )
    quiet, loud = (noise.apply(signals([celsius] * 20_000, output_v=0.0)).output_v for celsius in (20.0, 50.0))
    assert not quiet.any()
    assert loud.std() == pytest.approx(1e-3 * math.sqrt(3.0**2 - 1.0), rel=0.02)


def test_what_remembers_does_not_depend_on_how_a_run_is_cut() -> None:
    (memory,) = make_effects({"memory_of_bias_over_gyro_temp": {"c1": 1e-3, "tau": 0.05}})
    whole = signals(np.linspace(20.0, 40.0, 60).tolist(), output_v=0.0)
    first, then = (
        replace(whole, **{name: getattr(whole, name)[part] for name in ARRAYS}, first_index=part.start)
        for part in (slice(0, 25), slice(25, 60))
    )
    begun = memory.apply(first)
    parts = [begun.output_v, memory.apply(replace(then, memory=begun.memory)).output_v]
    np.testing.assert_allclose(np.concatenate(parts), memory.apply(whole).output_v, rtol=1e-12)


def test_what_remembers_takes_a_change_in_a_pause_to_be_in_its_middle() -> None:
    (memory,) = make_effects({"memory_of_bias_over_gyro_temp": {"c1": 1e-3, "tau": 0.3}})
    whole = signals([20.0] * 30 + [40.0] * 30, output_v=0.0)
    first, then = (
        replace(whole, **{name: getattr(whole, name)[part] for name in ARRAYS}, first_index=part.start)
        for part in (slice(0, 20), slice(40, 60))
    )
    behind = memory.apply(replace(then, memory=memory.apply(first).memory)).output_v
    np.testing.assert_allclose(behind, memory.apply(whole).output_v[40:], rtol=1e-9)


def test_a_function_of_two_coordinates_is_in_proportion_to_the_second() -> None:
    name = "kink_of_bias_over_gyro_temp_times_abs_rate"
    (kink,) = make_effects({name: {"at": 30.0, "above": 1e-5}})
    turning = replace(signals([20.0, 40.0, 40.0], 0.0), rate_dps=np.array([-50.0, -50.0, 100.0]))
    assert kink.apply(turning).output_v.tolist() == pytest.approx([0.0, 5e-3, 1e-2])
    assert kink.says() == (
        "Above 30 °C of the coil's temperature the bias rises by 0.01 mV per °/s of the size of the rate per °C."
    )
    kind = structure_named(name)
    assert kind is not None
    assert kind.word == kind.coordinate == "gyro_temp*abs_rate"
    assert kind.parameters["above"].unit == "V (degC)-1 (deg s-1)-1"


def test_a_hysteresis_differs_between_heating_and_cooling_and_does_not_depend_on_how_a_run_is_cut() -> None:
    (hysteresis,) = make_effects({"hysteresis_of_bias_over_gyro_temp": {"c1": 1e-3, "width": 2.0}})
    whole = signals([*range(20, 41), *range(39, 19, -1)], 0.0)
    volts = hysteresis.apply(whole).output_v
    assert volts[10] == pytest.approx(-2e-3)
    assert volts[-10] == pytest.approx(2e-3)
    first, then = (
        replace(whole, **{name: getattr(whole, name)[part] for name in ARRAYS}, first_index=part.start)
        for part in (slice(0, 17), slice(17, 41))
    )
    begun = hysteresis.apply(first)
    parts = [begun.output_v, hysteresis.apply(replace(then, memory=begun.memory)).output_v]
    np.testing.assert_allclose(np.concatenate(parts), volts, rtol=1e-12)


def test_a_name_of_no_structure_is_refused() -> None:
    assert structure_named("kink_of_scale_over_moon_phase") is None
    with pytest.raises(UsageError, match="there is no such effect"):
        make_effects({"kink_of_scale_over_moon_phase": {"at": 1.0, "above": 1.0}})


def test_within_a_range_places_are_bounded_by_it() -> None:
    at = structure("scale", "gyro_temp", "kink", (-10.0, 50.0)).parameters["at"]
    assert (at.low, at.high) == (-10.0, 50.0)
