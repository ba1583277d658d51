"""The noise of an encoder's rate is not taken for a property of the gyro."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.gyro.frame import Frame, frame_of
from benchctl.diagnosis.gyro.noisy_reference import without_noise
from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.recordings.reader import Recording
from tests.benchctl.diagnosis.made_recording import found_in, recording_of

RATE_HZ, SECONDS, FINER = 100.0, 60.0, 20
K0, U0, GYRO_DPS = -0.87, 0.05, 0.57
AROUND_S = 5.0


def recorded(
    *,
    reference_dps: float,
    delay_s: float = 0.0,
    cutoff_hz: float | None = None,
    shaking_dps: float = 0.0,
    rumbling_dps: float = 0.0,
    angle_noise_deg: float = 0.0,
    jump_deg: float = 0.0,
) -> Recording:
    """A swing of 0.1 and 0.37 Hz, whose angle is the sum of rates with white noise, as a controller logs them.

    Both sensors see a shaking of 6 Hz, and a rumble of 1 to 8 Hz. The angle itself may have white noise, as that of a
    real encoder has, and jump once.
    """
    chance = np.random.default_rng(0)
    fine_s = np.arange(-AROUND_S, SECONDS + AROUND_S, 1.0 / (FINER * RATE_HZ))
    rate = 200.0 + 200.0 * np.sin(2 * np.pi * 0.1 * fine_s) + 20.0 * np.sin(2 * np.pi * 0.37 * fine_s + 1.0)
    rate += shaking_dps * np.sin(2 * np.pi * 6.0 * fine_s)
    rumble = sosfilt(
        butter(4, (1.0, 8.0), "bandpass", fs=FINER * RATE_HZ, output="sos"),
        np.random.default_rng(1).standard_normal(rate.size),
    )
    rate += rumbling_dps * rumble / rumble.std()
    sensed = rate
    if cutoff_hz is not None:
        kept = np.exp(-2 * np.pi * cutoff_hz / (FINER * RATE_HZ))
        sensed = lfilter([1.0 - kept], [1.0, -kept], rate, zi=[kept * rate[0]])[0]
    time_s = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    logged = np.interp(time_s, fine_s, rate) + reference_dps * chance.standard_normal(time_s.size)
    felt = np.interp(time_s - delay_s, fine_s, sensed) + GYRO_DPS * chance.standard_normal(time_s.size)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (logged[1:] + logged[:-1]) / RATE_HZ)])
    angle += angle_noise_deg * chance.standard_normal(angle.size)
    angle[angle.size // 2 :] += jump_deg
    return recording_of({"time_s": time_s, "encoder_deg": np.mod(angle, 360.0), "gyro_v": U0 + K0 * felt})


def frame(recording: Recording) -> Frame:
    """All of its samples."""
    return frame_of(recording, temperature_c=20.0)


def test_a_delay_beside_a_noisy_reference_is_no_low_pass() -> None:
    diagnosis = diagnose(recorded(reference_dps=1.0, delay_s=-0.015))
    (finding,) = diagnosis.findings
    assert finding.effect == "timing_offset"
    assert finding.parameters["offset_s"].value == pytest.approx(-0.015, abs=1e-3)
    assert not diagnosis.unexplained.significant
    assert any("encoder's rate is noisy" in note for note in diagnosis.notes)


def test_a_low_pass_beside_a_noisy_reference_is_found_with_its_cutoff() -> None:
    found = found_in(gyro_problem(recorded(reference_dps=1.0, cutoff_hz=3.0)))
    assert set(found) == {"sensor_bandwidth"}
    assert found["sensor_bandwidth"].values["cutoff_hz"] == pytest.approx(3.0, abs=0.1)


def test_the_motion_keeps_what_both_see_and_loses_the_noise() -> None:
    quiet, noisy = frame(recorded(reference_dps=0.0)), frame(recorded(reference_dps=1.0))
    known = without_noise(noisy)
    inner = slice(known.reach, -known.reach)
    before, after = (np.std((one.rate_dps - quiet.rate_dps)[inner]) for one in (noisy, known))
    assert after < 0.4 * before
    assert known.known_hz is not None
    assert 0.37 < known.known_hz < 1.5


@pytest.mark.parametrize(("reference_dps", "shaking_dps"), [(0.0, 0.0), (0.1, 0.0), (1.0, 2.0)])
def test_a_motion_without_noticeable_noise_or_with_fast_shaking_is_left_as_it_is(
    reference_dps: float, shaking_dps: float
) -> None:
    whole = frame(recorded(reference_dps=reference_dps, shaking_dps=shaking_dps))
    assert without_noise(whole) is whole


def test_a_rumble_of_the_table_weaker_than_the_gyros_noise_is_motion_and_no_noise() -> None:
    whole = frame(recorded(reference_dps=0.0, rumbling_dps=0.16))
    assert without_noise(whole) is whole


def test_a_jump_of_the_angle_is_no_noise() -> None:
    whole = frame(recorded(reference_dps=0.0, jump_deg=1.0))
    assert without_noise(whole) is whole


def test_white_noise_of_the_angle_which_does_no_harm_at_slow_motion_leaves_the_motion_as_it_is() -> None:
    whole = frame(recorded(reference_dps=0.0, angle_noise_deg=0.02))
    assert without_noise(whole) is whole
