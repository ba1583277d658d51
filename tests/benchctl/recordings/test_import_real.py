"""Recordings by others: the examples, an IMU with an encoder, ovens, a drive."""

from __future__ import annotations

import gzip
import json
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from benchctl.recordings.import_open import read_open_recording
from benchctl.recordings.importing import import_recording, read_foreign
from benchctl.recordings.model import Step
from tests.shared import SHARED, needs_shared

MAPS = Path(__file__).parent / "maps"
EXAMPLES = SHARED / "recordings" / "examples"


@needs_shared("recordings/examples")
@pytest.mark.parametrize("name", ["null", "pair", "single"])
def test_an_example_gives_its_own_digits_back(name: str, tmp_path: Path) -> None:
    began = time.process_time()
    meta, steps = read_open_recording(EXAMPLES / name)
    assert time.process_time() - began < 5  # 0.5 to 0.9 s where nothing else runs
    lines = gzip.decompress((EXAMPLES / name / "samples.csv.gz").read_bytes()).decode().splitlines()
    assert sum(step.info.samples for step in steps) == len(lines) - 1
    assert len(steps) == len(json.loads((EXAMPLES / name / "recording.json").read_text())["steps"])
    decimals = meta.extra["csv_decimals"]
    columns = meta.extra["csv_columns"]
    pattern = ",".join(f"%.{decimals[column]}f" for column in columns)
    row = 1
    for step in steps:
        for k in range(0, step.info.samples, 97):
            assert pattern % tuple(step[column][k] for column in columns) == lines[row + k]
        row += step.info.samples


def _scale_and_delay(step: Step) -> tuple[float, float]:
    """Scale factor and delay (s) of the gyro against the encoder, from ∫gyro = scale·(θ - delay·ω) + drift."""
    t = step["time_s"]
    theta = np.unwrap(step["encoder_deg"], period=360)
    gyro = step["gyro_v"]
    turned = np.r_[0, np.cumsum((gyro[1:] + gyro[:-1]) / 2 * np.diff(t))]
    omega = np.gradient(theta, t)
    drift = np.vander(t / t[-1], 6)
    solved = np.linalg.lstsq(np.column_stack([theta, omega, drift])[2:-2], turned[2:-2], rcond=None)[0]
    return float(solved[0]), float(-solved[1] / solved[0])


@needs_shared("data/uiuc_encoder_imu")
def test_the_slow_yaw_of_the_imu_lies_on_one_clock() -> None:
    meta, (step,) = read_foreign(SHARED / "data/uiuc_encoder_imu/raw_yaw_slow.mat", MAPS / "uiuc.toml")
    told = json.loads(meta.provenance["treatment_json"])
    assert told["rows"] == 149_827 - 509
    assert told["resolution_s"] == 1e-3
    assert len(told["repeated_rows"]) == 26
    assert (told["missing"], told["filled"], told["stretches"]) == (26, 26, 1)
    assert told["rate_hz"] == pytest.approx(99.8910, abs=2e-4)
    # The stamps are a uniform clock, cut to whole milliseconds: nothing else is left in them.
    assert told["scatter_rms_s"] == pytest.approx(told["rounding_rms_s"], rel=0.03)
    # Each row that was written twice stands where a sample was lost.
    assert [row - 1 for row in told["repeated_rows"]] == [gap["after_row"] for gap in told["gaps"]]
    assert step.info.samples == 149_318
    assert int(step["filled"].sum()) == 26
    assert np.ptp(np.diff(step["time_s"])) < 1e-9
    assert "26 samples are missing in 26 gaps" in meta.provenance["treatment"]
    assert (meta.extra["gyro_output_unit"], meta.extra["channel_units"]["gyro_v"]) == ("deg/s", "degree s-1")


@needs_shared("data/uiuc_encoder_imu")
def test_the_delay_of_the_imu_survives_the_repair() -> None:
    _, (step,) = read_foreign(SHARED / "data/uiuc_encoder_imu/raw_yaw_medium.mat", MAPS / "uiuc.toml")
    scale, delay_s = _scale_and_delay(step)
    assert scale == pytest.approx(1.005, abs=0.003)
    assert delay_s == pytest.approx(12.0e-3, abs=0.5e-3)


@needs_shared("data/uiuc_encoder_imu")
def test_a_logger_that_pauses_two_hundred_times_gives_that_many_steps_on_one_clock() -> None:
    meta, steps = read_foreign(SHARED / "data/uiuc_encoder_imu/raw_roll_slow.mat", MAPS / "uiuc.toml")
    treatment = json.loads(meta.provenance["treatment_json"])
    assert 150 < treatment["restarts"] < 250
    assert len(steps) == treatment["stretches"] == treatment["restarts"] + 1
    assert sum(step.info.samples for step in steps) == 149_794
    assert treatment["rate_hz"] == pytest.approx(100.0, rel=2e-3)
    stamps = np.concatenate([step.channels["time_s"] for step in steps])
    assert np.diff(stamps).min() > 0.0


@needs_shared("data/servo_mount")
def test_columns_between_blanks_import(tmp_path: Path) -> None:
    meta, steps = read_foreign(SHARED / "data/servo_mount/10_22_1.dat", MAPS / "servo_mount.toml")
    assert sum(step.info.samples for step in steps) == 3866
    assert meta.extra["gyro_output_unit"] == "deg/s"
    assert steps[0].channels["gyro_v"][0] == pytest.approx(np.degrees(-0.507018))


@needs_shared("data/thermal")
@pytest.mark.parametrize(
    ("name", "mapping", "samples", "rate_hz", "first_c"),
    [
        ("2024-07-27__signals_step_30_percent.log", "oven_step", 1440, 2.0, 27.25),
        ("2024-10-30__signals_profile_controlled3.log", "oven_profile", 1441, 2.0, 23.25),
        ("cooldown_20130419_13.24.44.csv", "cold_finger", 1120, None, 37.8),
    ],
)
def test_logs_of_ovens_and_coolers_import(
    tmp_path: Path, name: str, mapping: str, samples: int, rate_hz: float | None, first_c: float
) -> None:
    output = tmp_path / "thermal.h5"
    done = import_recording(SHARED / "data" / "thermal" / name, MAPS / f"{mapping}.toml", output)
    assert (done.steps, done.samples) == (1, samples)
    with h5py.File(output) as file:
        (group,) = file["steps"].values()
        assert group["chamber_temp_c"][0] == first_c
        assert group["chamber_temp_c"].attrs["units"] == "degC"
        assert group.attrs["kind"] == "thermal_ramp"
        assert group.attrs.get("sample_rate_hz") == (None if rate_hz is None else pytest.approx(rate_hz, rel=1e-5))


@needs_shared("data/table_drive")
def test_a_drives_channels_keep_their_names_and_units(tmp_path: Path) -> None:
    output = tmp_path / "drive.h5"
    import_recording(SHARED / "data/table_drive/idf_pos_0.065_1.mat", MAPS / "drive.toml", output)
    with h5py.File(output) as file:
        (group,) = file["steps"].values()
        units = {name: dataset.attrs["units"] for name, dataset in group.items()}
        assert units == {
            "time_s": "s",
            "encoder_deg": "degree",
            "velocity_rad_s": "rad s-1",
            "torque_demand_nm": "N m",
            "torque_nm": "N m",
            "current_a": "A",
        }
        assert group["time_s"].shape == (20_000,)
        turned = np.ptp(np.unwrap(group["encoder_deg"][:], period=360))
        assert turned == pytest.approx(np.rad2deg(np.sum(group["velocity_rad_s"][:]) * 1e-3), rel=0.02)
