"""Gyros on shafts that move as motors do: a stepper's shaft (UIUC) and a servo's mount, by who measured them."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.diagnosis.diagnose import diagnose
from benchctl.diagnosis.result import Diagnosis
from benchctl.recordings.importing import import_recording
from benchctl.recordings.reader import join, open_recording
from tests.shared import SHARED, needs_shared

MAPS = Path(__file__).parents[1] / "benchctl" / "recordings" / "maps"
AXES = {"pitch": "y", "roll": "x", "yaw": "z"}


def uiuc(name: str, folder: Path) -> Diagnosis:
    """The diagnosis of a recording of the stepper-driven shaft, of the axis that it turned about."""
    text = (MAPS / "uiuc.toml").read_text()
    text = text.replace("all_gyro_2_z", f"all_gyro_2_{AXES[name.split('_')[0]]}")
    mapping, recorded = folder / "map.toml", folder / f"{name}.h5"
    mapping.write_text(text)
    import_recording(SHARED / "data" / "uiuc_encoder_imu" / f"raw_{name}.mat", mapping, recorded)
    with open_recording(recorded) as recording:
        return diagnose(recording)


@pytest.mark.long
@pytest.mark.timeout(900)
@needs_shared("data/uiuc_encoder_imu")
@pytest.mark.parametrize("name", ["pitch_slow", "roll_slow", "yaw_slow", "yaw_medium"])
def test_one_board_has_one_delay_and_no_low_pass_on_every_axis(name: str, tmp_path: Path) -> None:
    diagnosis = uiuc(name, tmp_path)
    findings = {one.effect: one for one in diagnosis.findings}
    assert findings["timing_offset"].parameters["offset_s"].value == pytest.approx(12.1e-3, abs=0.3e-3)
    assert not {"sensor_bandwidth", "mains_pickup"} & set(findings)
    assert diagnosis.fit.heldout_after < diagnosis.fit.heldout_before


@pytest.mark.long
@pytest.mark.timeout(900)
@needs_shared("data/servo_mount")
def test_a_mount_that_gives_way_has_a_delay_and_a_gain_that_rises(tmp_path: Path) -> None:
    recordings = []
    for number in (1, 4):
        file = tmp_path / f"{number}.h5"
        import_recording(SHARED / "data" / "servo_mount" / f"10_22_{number}.dat", MAPS / "servo_mount.toml", file)
        recordings.append(open_recording(file))
    diagnosis = diagnose(join(recordings))
    for recording in recordings:
        recording.close()
    findings = {one.effect: one for one in diagnosis.findings}
    assert set(findings) == {"timing_offset", "mount_resonance"}
    assert findings["timing_offset"].parameters["offset_s"].value == pytest.approx(6.5e-3, abs=0.7e-3)
    mount = findings["mount_resonance"].parameters
    assert mount["frequency_hz"].value > 10.0  # beyond the motion, whose gain it makes rise
    assert (mount["damping"].low, mount["damping"].high) == (0.002, 0.5)
    assert diagnosis.fit.heldout_after < 7.0


@pytest.mark.long
@needs_shared("data/servo_mount")
def test_a_slow_swing_alone_shows_that_the_output_is_late_and_not_by_which_of_four_effects(tmp_path: Path) -> None:
    file = tmp_path / "1.h5"
    import_recording(SHARED / "data" / "servo_mount" / "10_22_1.dat", MAPS / "servo_mount.toml", file)
    with open_recording(file) as recording:
        diagnosis = diagnose(recording)
    (finding,) = diagnosis.findings
    stated = {finding.effect, *(one.effect for one in finding.alternatives)}
    assert stated == {"timing_offset", "mount_resonance", "sensor_bandwidth", "angular_acceleration"}
    assert diagnosis.fit.heldout_after < diagnosis.fit.heldout_before
