"""A digital gyro's frames as the output of the unit under test: instants, angles, gaps, samples not vouched for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchctl.recordings.model import Meta, Step
from benchctl.recordings.reader import Recording, open_recording
from benchctl.recordings.stated import stated_of
from benchctl.recordings.writer import write_recording
from benchctl.signals.reduce import reduce_step
from benchctl.signals.under_test import under_test
from benchctl_instruments.arrays import FloatArray
from tests.benchctl.recordings.made import POLLED, STREAMED, info, meta

SCANS_HZ, FRAMES_HZ, SECONDS = 500.0, 320.0, 8.0
PEAK_DPS, SWING_HZ = 100.0, 1.0
LATE_S = 0.0007


def angle_deg(time_s: FloatArray) -> FloatArray:
    return 350.0 + PEAK_DPS / (2.0 * np.pi * SWING_HZ) * (1.0 - np.cos(2.0 * np.pi * SWING_HZ * time_s))


def rate_dps(time_s: FloatArray) -> FloatArray:
    return PEAK_DPS * np.sin(2.0 * np.pi * SWING_HZ * time_s)


def swing() -> Step:
    """A sine at 500 scans and 320 frames a second; the first frame is before the first scan."""
    time_s = np.arange(int(SECONDS * SCANS_HZ)) / SCANS_HZ
    frame_s = LATE_S - 1.0 / FRAMES_HZ + np.arange(int(SECONDS * FRAMES_HZ)) / FRAMES_HZ
    described = info(1, kind="sine", t_start=0.0, t_end=SECONDS, frequency_hz=SWING_HZ, amplitude_dps=PEAK_DPS)
    return Step(
        replace(described, samples=time_s.size, sample_rate_hz=SCANS_HZ, frame_rate_hz=FRAMES_HZ, frames_lost=0),
        {
            "time_s": time_s,
            "encoder_deg": np.mod(angle_deg(time_s), 360.0),
            "gyro_v": np.full(time_s.size, 0.3),
            "gyro_temp_c": np.full(time_s.size, 20.0),
            "poll_time_s": np.array([0.0, 4.0]),
            "poll_chamber_temp_c": np.array([20.0, 20.0]),
            "poll_gyro_v": np.array([0.3, 0.3]),
            "frame_time_s": frame_s,
            "frame_rate_dps": rate_dps(frame_s - 0.002),
            "frame_temp_c": np.full(frame_s.size, 31.0),
            "frame_status": np.zeros(frame_s.size),
        },
    )


def written(tmp_path: Path, step: Step, described: Meta | None = None) -> Recording:
    path = tmp_path / "r.h5"
    write_recording(path, described or meta(), [step])
    return open_recording(path)


def test_the_angle_is_that_of_the_frames_instants_and_the_output_is_untouched(tmp_path: Path) -> None:
    with under_test(written(tmp_path, swing())) as recording:
        step = recording.step(1)
        assert set(recording.channels(1)) == {*STREAMED, *POLLED}
        assert recording.meta.output_unit == "deg/s"
        assert (recording.infos[0].samples, recording.infos[0].sample_rate_hz) == (step["time_s"].size, FRAMES_HZ)
    np.testing.assert_allclose(step["encoder_deg"], np.mod(angle_deg(step["time_s"]), 360.0), rtol=0.0, atol=1e-6)
    np.testing.assert_array_equal(step["gyro_v"], swing()["frame_rate_dps"][1:])
    assert set(step["gyro_temp_c"]) == {31.0}


def test_a_part_of_a_long_step_has_the_angles_of_the_whole(tmp_path: Path) -> None:
    with under_test(written(tmp_path, swing())) as recording:
        whole, stored = recording.step(1), recording.stored_step(1)
        part = stored.part(700, 1500)
    np.testing.assert_allclose(part["encoder_deg"], whole["encoder_deg"][700:1500], rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(part["gyro_v"], whole["gyro_v"][700:1500])


def test_the_delay_of_the_frames_and_a_scale_factor_near_one_are_found_across_missing_frames(tmp_path: Path) -> None:
    made = swing()
    kept = np.ones(made["frame_time_s"].size, dtype=np.bool_)
    kept[1000:1003] = False
    step = Step(
        made.info,
        {name: values[kept] if name.startswith("frame") else values for name, values in made.channels.items()},
    )
    with under_test(written(tmp_path, step)) as recording:
        reduced = reduce_step(recording.stored_step(1), recording.meta)
    assert reduced is not None
    assert reduced.delay_s == pytest.approx(0.002, abs=2e-6)
    assert np.polyfit(reduced.rate_dps, reduced.output_v, 1)[0] == pytest.approx(1.0, abs=1e-4)
    assert np.diff(reduced.time_s).max() > 1.5 * np.median(np.diff(reduced.time_s))  # nothing is averaged across it


def test_a_sample_that_the_gyro_does_not_vouch_for_is_masked(tmp_path: Path) -> None:
    step = swing()
    step["frame_status"][800:805] = 256.0
    step["frame_rate_dps"][800:805] = 1e4
    with under_test(written(tmp_path, step)) as recording:
        reduced = reduce_step(recording.stored_step(1), recording.meta)
    assert reduced is not None
    assert reduced.masked == 5
    assert np.abs(reduced.output_v).max() < 1.01 * PEAK_DPS


def test_frames_beside_a_gap_of_the_scans_have_no_angle_and_are_left_out(tmp_path: Path) -> None:
    made = swing()
    kept = np.ones(made["time_s"].size, dtype=np.bool_)
    kept[2000:2500] = False
    step = Step(
        made.info, {name: values[kept] if name in STREAMED else values for name, values in made.channels.items()}
    )
    with under_test(written(tmp_path, step)) as recording:
        stored, loaded = recording.stored_step(1), recording.step(1)
        angles = stored.read("encoder_deg", 0, stored.scans)
    missing = np.isnan(angles)
    assert missing.sum() == pytest.approx(FRAMES_HZ, abs=2)  # one second
    assert loaded["time_s"].size == stored.scans - missing.sum()
    np.testing.assert_allclose(loaded["encoder_deg"], np.mod(angle_deg(loaded["time_s"]), 360.0), rtol=0.0, atol=1e-6)


def test_a_recording_without_frames_stays_as_it_is(tmp_path: Path) -> None:
    step = swing()
    analogue = Step(step.info, {name: values for name, values in step.channels.items() if "frame" not in name})
    with written(tmp_path, analogue) as recording:
        assert under_test(recording) is recording


def test_the_converter_of_volts_and_its_model_have_no_part_in_frames(tmp_path: Path) -> None:
    model = {"K0_v_per_dps": -0.05, "U0_v": 0.01, "T0_c": 20.0, "k_T": [1e-4], "k_omega": [], "output_limit_v": 11.0}
    with under_test(written(tmp_path, swing(), replace(meta(), simulation=model))) as recording:
        described = recording.meta
    assert described.bench.adc_step_v == 0.0
    assert described.simulation == {
        **{"K0_v_per_dps": 1.0, "U0_v": 0.0, "T0_c": 20.0, "k_T": [1e-4], "k_omega": []},
        "output_limit_v": pytest.approx(220.0),
    }
    assert (stated_of(described).gain_ppm.standard, stated_of(described).offset_v.standard) == (0.0, 0.0)


def test_a_model_that_is_already_of_the_rate_is_kept(tmp_path: Path) -> None:
    model = {"K0_v_per_dps": 0.9987, "U0_v": 0.02, "T0_c": 20.0, "k_T": [], "k_omega": []}
    with under_test(written(tmp_path, swing(), replace(meta(), simulation=model))) as recording:
        assert recording.meta.simulation == model
