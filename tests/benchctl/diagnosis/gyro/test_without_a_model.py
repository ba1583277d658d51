"""A recording that states no model of its gyro is compared with a straight line in the rate."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.recordings.reader import Recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis.made_recording import recording_of

RATE_HZ = 100.0
DELAY_S = 0.012


def recorded(K0: float, U0: float, *, unit: str, amplitude_dps: float = 40.0, delay_s: float = DELAY_S) -> Recording:
    """Two slow sines about the axis, read by a fine encoder, and a gyro whose samples are late by `delay_s`."""
    chance = np.random.default_rng(5)
    time_s = np.arange(0.0, 300.0, 1.0 / RATE_HZ)

    def angle(at: np.ndarray) -> np.ndarray:
        turned: np.ndarray = sum(amplitude_dps / (2 * np.pi * f) * np.sin(2 * np.pi * f * at) for f in (0.11, 0.37))
        return turned

    def rate(at: np.ndarray) -> np.ndarray:
        turns: np.ndarray = sum(amplitude_dps * np.cos(2 * np.pi * f * at) for f in (0.11, 0.37))
        return turns

    output = U0 + K0 * rate(time_s - delay_s) + 1e-3 * abs(K0) * chance.standard_normal(time_s.size)
    channels = {
        "time_s": time_s,
        "encoder_deg": np.mod(180.0 + angle(time_s) + 1e-5 * chance.standard_normal(time_s.size), 360.0),
        "gyro_v": output,
    }
    return recording_of(channels, gyro_output_unit=unit, channel_units={"gyro_v": unit})


def test_an_analogue_gyro_is_compared_with_the_line_that_fits_best() -> None:
    problem = gyro_problem(recorded(-0.05, 2.5, unit="V"))
    assert problem.baseline_start == pytest.approx([-0.05, 2.5], rel=2e-3)
    assert not problem.believed


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_unit_of_a_digital_gyro_states_its_scale_factor(sign: float) -> None:
    problem = gyro_problem(recorded(sign * 1.03, 0.4, unit="deg/s"))
    assert problem.baseline_start.tolist() == [sign, 0.0]
    assert problem.believed


def test_a_table_that_never_turns_shows_no_scale_factor() -> None:
    with pytest.raises(UsageError, match="the table never turns"):
        gyro_problem(recorded(0.05, 2.5, unit="V", amplitude_dps=0.0, delay_s=0.0))


def swung(seed: int) -> Recording:
    """One sine of 7 Hz; the gyro is 7 ms late, 8 % too large, and shakes at multiples of the sine, as mounts do."""
    chance, swing = np.random.default_rng(seed), 2.0 * np.pi * 7.0
    time_s = np.arange(0.0, 8.0, 0.002)
    late = time_s - 0.007
    output = 1.08 * 115.0 * np.cos(swing * late) + 2.0 * chance.standard_normal(time_s.size)
    for order, amplitude in ((2, 7.0), (3, 6.0), (4, 6.0), (7, 4.0)):
        output += amplitude * np.sin(order * swing * late + 6.0 * chance.random())
    channels = {
        "time_s": time_s,
        "encoder_deg": np.mod(115.0 / swing * np.sin(swing * time_s), 360.0),
        "gyro_v": output,
    }
    return recording_of(channels, gyro_output_unit="deg/s", channel_units={"gyro_v": "deg/s"})


@pytest.mark.long
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "seed",
    [
        1,
        pytest.param(2, marks=pytest.mark.xfail(strict=False, reason="the delay falls beside a structure of the rate")),
    ],
)
def test_one_frequency_does_not_separate_a_delay_from_a_low_pass_and_both_are_stated(seed: int) -> None:
    diagnosis = diagnose(swung(seed))
    late = {"timing_offset", "sensor_bandwidth", "angular_acceleration", "mount_resonance"}
    (finding,) = [one for one in diagnosis.findings if one.effect in late]
    assert {"timing_offset", "sensor_bandwidth"} <= {finding.effect, *(one.effect for one in finding.alternatives)}
    assert max(one.probability for one in finding.alternatives) > 0.1
    assert finding.effect != "timing_offset" or finding.parameters["offset_s"].value == pytest.approx(7e-3, abs=1e-3)
    assert "mains_pickup" not in {one.effect for one in diagnosis.findings}
    assert set(diagnosis.next_experiment.separates) == {
        finding.effect,
        finding.alternatives[0].effect,
    }


def test_no_model_takes_a_stated_scale_factor_beyond_twice_itself() -> None:
    problem = gyro_problem(recorded(-1.03, 0.4, unit="deg/s"))
    assert problem.baseline_bounds == {"K0_v_per_dps": (-2.0, -0.5)}
    assert gyro_problem(recorded(-0.05, 2.5, unit="V")).baseline_bounds == {}
