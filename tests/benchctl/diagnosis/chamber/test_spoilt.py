"""A chamber's readings that are none: a converter at its rail, a counter that wraps, spikes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis.chamber.problem import chamber_problem
from benchctl.diagnosis.data_faults import without_data_faults
from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.faults import Fault
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis.made_chamber import GAIN_C_PER_PERCENT, ROOM_C, TAU_S, Truth, chamber_channels
from tests.benchctl.diagnosis.made_recording import found_in, recording_of

FloatArray = npt.NDArray[np.float64]

LAG_S = 40.0


@pytest.fixture(scope="module")
def sound() -> dict[str, FloatArray]:
    """A chamber with a second lag, whose air goes from 24 to 218 °C and comes back."""
    return chamber_channels(Truth(second_lag_s=LAG_S), 1)


def faults_of(channels: dict[str, FloatArray], **changed: FloatArray) -> tuple[Fault, ...]:
    return without_data_faults(chamber_problem(recording_of({**channels, **changed})))[1]


def read(air_c: FloatArray, *, step_c: float = 0.25, noise_c: float = 0.05) -> FloatArray:
    noise = np.random.default_rng(4).normal(0.0, noise_c, air_c.size)
    return np.asarray(np.round((air_c + noise) / step_c) * step_c)


def heated(time_s: FloatArray, percent: FloatArray) -> FloatArray:
    """Air [°C] with one lag, shape (n,)."""
    air_c = np.empty_like(time_s)
    air_c[0] = ROOM_C
    step = float(time_s[1] - time_s[0]) / TAU_S
    for k in range(1, time_s.size):
        air_c[k] = air_c[k - 1] + step * (GAIN_C_PER_PERCENT * percent[k - 1] - (air_c[k - 1] - ROOM_C))
    return air_c


def test_a_sound_chamber_has_no_faults_of_the_data(sound: dict[str, FloatArray]) -> None:
    assert faults_of(sound) == ()


@pytest.mark.parametrize("limit_c", [150.0, 180.0])
def test_air_at_its_converters_rail_is_told_with_the_limit(sound: dict[str, FloatArray], limit_c: float) -> None:
    clipped = np.minimum(sound["chamber_temp_c"], limit_c)
    problem, (fault,) = without_data_faults(chamber_problem(recording_of({**sound, "chamber_temp_c": clipped})))
    assert fault.effect == "saturation"
    (limit,) = fault.parameters.values()
    assert limit.value == limit_c
    assert limit.unit == "degC"
    assert not (fault.rows & problem.usable).any()
    assert (problem.measured[problem.usable] < limit_c).all()


def test_a_cooled_chamber_has_a_rail_below_its_zero_with_its_sign() -> None:
    time_s = np.arange(0.0, 1500.0, 0.5)
    current_a = np.select([time_s < 60.0, time_s < 700.0], [0.0, 4.0], 1.0)
    air_c = heated(time_s, -5.0 * current_a)
    channels = {"time_s": time_s, "chamber_temp_c": np.maximum(read(air_c), -40.0), "current_a": current_a}
    (fault,) = faults_of(channels)
    assert fault.effect == "saturation"
    assert fault.parameters["limit_c"].value == -40.0


def test_air_that_settles_under_a_constant_power_is_at_no_rail() -> None:
    time_s = np.arange(0.0, 4000.0, 0.5)
    percent = np.where(time_s < 40.0, 0.0, 9.0)
    read_c = read(heated(time_s, percent), noise_c=0.01)
    assert np.count_nonzero(read_c == read_c.max()) > 1000
    assert faults_of({"time_s": time_s, "chamber_temp_c": read_c, "heater_percent": percent}) == ()


def test_air_that_a_bang_bang_heater_holds_is_at_no_rail() -> None:
    time_s = np.arange(0.0, 4000.0, 0.5)
    percent = np.zeros(time_s.size)
    air_c = np.full(time_s.size, ROOM_C)
    for k in range(1, time_s.size):
        percent[k] = 30.0 if air_c[k - 1] < 59.9 or (percent[k - 1] > 0.0 and air_c[k - 1] < 60.0) else 0.0
        air_c[k] = air_c[k - 1] + (GAIN_C_PER_PERCENT * percent[k] - (air_c[k - 1] - ROOM_C)) * 0.5 / TAU_S
    read_c = read(air_c, step_c=1.0)
    assert np.count_nonzero(read_c == read_c.max()) > 1000
    assert faults_of({"time_s": time_s, "chamber_temp_c": read_c, "heater_percent": percent}) == ()


def following(asked_c: FloatArray) -> FloatArray:
    """Air [°C] that follows a set point, once a second, with a limited ramp and one lag; shape (n,)."""
    led = air = 20.0
    told = []
    for wanted in asked_c.tolist():
        led += min(max(wanted - led, -0.04), 0.04)
        air += (led - air) / 5.0
        told.append(air)
    return np.array(told)


def test_a_chamber_that_stands_at_its_set_point_is_at_no_rail_and_one_that_stands_short_of_it_is() -> None:
    time_s = np.arange(0.0, 6000.0, 1.0)
    asked_c = np.select([time_s < 300, time_s < 2000, time_s < 4000], [20.0, 60.0, 100.0], 30.0)
    read_c = read(following(asked_c), step_c=0.1, noise_c=0.02)
    channels = {"time_s": time_s, "chamber_setpoint_c": asked_c}
    assert faults_of(channels, chamber_temp_c=np.minimum(read_c, 100.0)) == ()
    (fault,) = faults_of(channels, chamber_temp_c=np.minimum(read_c, 85.0))
    assert fault.parameters["limit_c"].value == 85.0


@pytest.mark.parametrize(("lowest_c", "modulus_k"), [(-128.0, 256.0), (0.0, 200.0)])
def test_a_temperature_that_wraps_like_a_counter_is_told_with_its_modulus(
    sound: dict[str, FloatArray], lowest_c: float, modulus_k: float
) -> None:
    read_c = np.mod(sound["chamber_temp_c"] - lowest_c, modulus_k) + lowest_c
    problem, (fault,) = without_data_faults(chamber_problem(recording_of({**sound, "chamber_temp_c": read_c})))
    assert fault.effect == "counter_wrap"
    (modulus,) = fault.parameters.values()
    assert modulus.low < modulus_k < modulus.high
    assert modulus.unit == "K"
    # the last reading within the range, and one that noise has taken back into it
    assert problem.measured[problem.usable].max() == pytest.approx(lowest_c + modulus_k, abs=1.0)
    assert problem.measured[problem.usable].min() == pytest.approx(ROOM_C, abs=1.0)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_spikes_of_one_height_are_no_counter(sound: dict[str, FloatArray], count: int) -> None:
    """Where the air still has its first temperature, a spike leaves and comes back as a counter does."""
    spoilt = sound["chamber_temp_c"].copy()
    spoilt[20 : 20 + 10 * count : 10] = 1000.0
    (fault,) = faults_of(sound, chamber_temp_c=spoilt)
    assert fault.effect == "outliers"
    assert fault.parameters["scale_k"].value == pytest.approx(1000.0 - ROOM_C, rel=0.03)


def test_a_flag_spikes_and_a_rail_in_one_recording_are_each_told(sound: dict[str, FloatArray]) -> None:
    read_c = np.minimum(sound["chamber_temp_c"], 180.0)
    read_c[[200, 900, 2300]] = 1500.0
    flags = np.zeros(read_c.size)
    flags[300:310] = 1.0
    faults = faults_of(sound, chamber_temp_c=read_c, chamber_temp_open=flags)
    assert [one.effect for one in faults] == ["dropouts", "outliers", "saturation"]


@pytest.mark.slow
@pytest.mark.parametrize("spoil", ["rail", "wrap"])
def test_the_lag_beside_a_fault_is_as_right_as_without_it(sound: dict[str, FloatArray], spoil: str) -> None:
    air_c = sound["chamber_temp_c"]
    read_c = np.minimum(air_c, 180.0) if spoil == "rail" else np.mod(air_c, 190.0)
    problem, faults = without_data_faults(chamber_problem(recording_of({**sound, "chamber_temp_c": read_c})))
    assert len(faults) == 1
    found = found_in(problem)
    assert list(found) == ["second_lag"]
    assert found["second_lag"].values["tau_s"] == pytest.approx(LAG_S, rel=0.1)


@pytest.mark.slow
def test_a_rail_of_the_thermometer_is_a_finding_of_the_diagnosis(sound: dict[str, FloatArray]) -> None:
    clipped = np.minimum(sound["chamber_temp_c"], 180.0)
    diagnosis = diagnose(recording_of({**sound, "chamber_temp_c": clipped}), part="chamber")
    found = {one.effect: one for one in diagnosis.findings}
    assert set(found) == {"second_lag", "saturation"}
    assert found["saturation"].where.coordinate == "chamber_temp"
    assert not diagnosis.unexplained.significant


def test_a_counter_that_leaves_too_few_readings_is_refused(sound: dict[str, FloatArray]) -> None:
    with pytest.raises(UsageError, match="a diagnosis of a chamber needs 60 or more"):
        chamber_problem(recording_of({**sound, "chamber_temp_c": np.mod(sound["chamber_temp_c"], 26.0)}))
