"""A drive's samples that are none: wrapped counters, a torque at its converter's rail, spikes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis.data_faults import without_data_faults
from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.drive.problem import drive_problem
from benchctl.diagnosis.faults import Fault
from tests.benchctl.diagnosis.made_drive import INERTIA, VISCOUS, Truth, drive_channels
from tests.benchctl.diagnosis.made_recording import found_in, recording_of

FloatArray = npt.NDArray[np.float64]

COULOMB_NM = 0.02


@pytest.fixture(scope="module")
def sound() -> dict[str, FloatArray]:
    """A drive with dry friction, whose torque reaches to ±0.59 N·m."""
    return drive_channels(Truth(coulomb=COULOMB_NM), 1)


def faults_of(channels: dict[str, FloatArray], **changed: FloatArray) -> tuple[Fault, ...]:
    return without_data_faults(drive_problem(recording_of({**channels, **changed})))[1]


def spiked(torque_nm: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    draws = np.random.default_rng(7)
    rows = draws.choice(torque_nm.size, count, replace=False)
    heights = draws.choice([-1.0, 1.0], count) * draws.uniform(0.3, 2.0, count)
    spoilt = torque_nm.copy()
    spoilt[rows] += heights
    return spoilt, heights


def wrapped(values: FloatArray, modulus: float) -> FloatArray:
    """As a counter about 0 has them."""
    return np.mod(values + modulus / 2, modulus) - modulus / 2


def test_a_sound_drive_has_no_faults_of_the_data(sound: dict[str, FloatArray]) -> None:
    assert faults_of(sound) == ()


@pytest.mark.parametrize(
    ("limits", "effect", "parameters"),
    [
        ((-1.0, 0.4), "saturation", {"limit_nm": 0.4}),
        ((-0.35, 1.0), "saturation", {"limit_nm": -0.35}),
        ((-0.35, 0.4), "two_rails", {"lower_nm": -0.35, "upper_nm": 0.4}),
    ],
)
def test_a_torque_at_its_converters_rail_is_told_with_the_limit(
    sound: dict[str, FloatArray], limits: tuple[float, float], effect: str, parameters: dict[str, float]
) -> None:
    problem, (fault,) = without_data_faults(
        drive_problem(recording_of({**sound, "torque_nm": np.clip(sound["torque_nm"], *limits)}))
    )
    assert fault.effect == effect
    assert {name: one.value for name, one in fault.parameters.items()} == pytest.approx(parameters)
    assert {one.unit for one in fault.parameters.values()} == {"N m"}
    assert not (fault.rows & problem.usable).any()


def test_a_torque_that_the_drive_itself_limits_is_at_no_rail() -> None:
    limited = drive_channels(Truth(coulomb=COULOMB_NM, most=0.35), 1)
    assert np.count_nonzero(limited["torque_nm"] == 0.35) > 1000
    assert faults_of(limited) == ()


def test_a_torque_that_wraps_like_a_counter_is_told_with_its_modulus(sound: dict[str, FloatArray]) -> None:
    read_nm = wrapped(np.round(sound["torque_nm"], 3), 0.8)
    problem, (fault,) = without_data_faults(drive_problem(recording_of({**sound, "torque_nm": read_nm})))
    assert fault.effect == "counter_wrap"
    (modulus,) = fault.parameters.values()
    assert modulus.low < 0.8 < modulus.high
    assert modulus.value == pytest.approx(0.8, rel=2e-3)
    assert fault.rows.any()
    assert not (fault.rows & problem.usable).any()


def test_spikes_of_the_torque_are_told_with_how_many_and_how_large(sound: dict[str, FloatArray]) -> None:
    spoilt, heights = spiked(sound["torque_nm"], 40)
    (fault,) = faults_of(sound, torque_nm=spoilt)
    assert fault.effect == "outliers"
    fraction, scale = fault.parameters["fraction"], fault.parameters["scale_nm"]
    assert fraction.low < 40 / spoilt.size < fraction.high
    assert scale.low < float(np.sqrt(np.mean(heights**2))) < scale.high
    assert "40 samples of the torque are spikes" in fault.says


@pytest.mark.parametrize("spoil", ["rail", "wrap", "spikes"])
def test_the_friction_beside_a_fault_is_as_right_as_without_it(sound: dict[str, FloatArray], spoil: str) -> None:
    torque_nm = sound["torque_nm"]
    spoilt = {
        "rail": np.minimum(torque_nm, 0.4),
        "wrap": wrapped(torque_nm, 0.8),
        "spikes": spiked(torque_nm, 40)[0],
    }[spoil]
    problem, faults = without_data_faults(drive_problem(recording_of({**sound, "torque_nm": spoilt})))
    assert len(faults) == 1
    found = found_in(problem)
    assert list(found) == ["coulomb_friction"]
    assert found["coulomb_friction"].values["coulomb_nm"] == pytest.approx(COULOMB_NM, rel=0.02)


@pytest.mark.parametrize("modulus_deg", [180.0, 360.0 / 7, 655.36])
def test_an_encoder_that_wraps_by_no_turn_is_unwrapped_and_told(
    sound: dict[str, FloatArray], modulus_deg: float
) -> None:
    turned = np.unwrap(sound["encoder_deg"], period=360.0)
    sound_problem = drive_problem(recording_of(sound))
    problem, (fault,) = without_data_faults(
        drive_problem(recording_of({**sound, "encoder_deg": np.mod(turned, modulus_deg)}))
    )
    assert fault.effect == "counter_wrap"
    assert fault.parameters["modulus_deg"].value == pytest.approx(modulus_deg, rel=1e-5)
    assert not fault.rows.any()
    assert problem.baseline_start == pytest.approx(sound_problem.baseline_start, rel=1e-3)


@pytest.mark.parametrize("whole_turns", [1, 2])
def test_an_encoder_that_turns_freely_and_wraps_by_whole_turns_has_no_fault(
    sound: dict[str, FloatArray], whole_turns: int
) -> None:
    turned = np.unwrap(sound["encoder_deg"], period=360.0)
    assert np.ptp(turned) > 3600.0
    assert faults_of(sound, encoder_deg=np.mod(turned, 360.0 * whole_turns)) == ()
    assert faults_of(sound, encoder_deg=wrapped(turned, 360.0)) == ()


@pytest.mark.parametrize("noise", ["normal", "uniform"])
def test_a_torque_that_leaps_between_two_levels_is_no_counter(noise: str) -> None:
    """A motor that is switched: every leap is of one size, as a wrap's is, and little takes it beyond its levels."""
    time_s = np.arange(0.0, 60.0, 0.002)
    torque_nm = np.where(np.mod(time_s, 3.0) < 1.5, 0.3, -0.3)
    rate, angle, angles = 0.0, 0.0, []
    for push in torque_nm.tolist():
        rate += 0.002 * (push - VISCOUS * rate) / INERTIA
        angle += 0.002 * rate
        angles.append(angle)
    draws = np.random.default_rng(2)
    unknown = draws.normal(0.0, 0.01, time_s.size) if noise == "normal" else draws.uniform(-0.01, 0.01, time_s.size)
    channels = {"time_s": time_s, "encoder_deg": np.mod(np.degrees(angles), 360.0), "torque_nm": torque_nm + unknown}
    assert faults_of(channels) == ()


def test_a_wrapped_encoder_and_a_rail_are_findings_of_the_diagnosis(sound: dict[str, FloatArray]) -> None:
    spoilt = {
        **sound,
        "torque_nm": np.minimum(sound["torque_nm"], 0.4),
        "encoder_deg": np.mod(sound["encoder_deg"], 180.0),
    }
    found = {one.effect: one for one in diagnose(recording_of(spoilt), part="drive").findings}
    assert set(found) == {"coulomb_friction", "counter_wrap", "saturation"}
    assert found["counter_wrap"].where.coordinate == "angle"
    assert found["saturation"].where.coordinate == "output"
    assert found["saturation"].explains > 0.05
