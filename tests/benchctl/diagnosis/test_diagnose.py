"""The engine against recordings of a generator that shares no code with it, and against the open examples."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis import diagnose
from benchctl.recordings.reader import Recording, open_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis.foreign import Truth, draw, make, to_recording
from tests.benchctl.diagnosis.made_recording import recording_of
from tests.benchctl.diagnosis.moving import KINDS, write_moving
from tests.shared import SHARED, needs_shared


def _recorded(truth: Truth, seed: int):  # type: ignore[no-untyped-def]
    return to_recording(*make(truth, seed))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_where_nothing_is_missing_no_effect_is_found() -> None:
    found = diagnose(_recorded(draw("null", 3), 3))
    assert found.findings == ()
    assert found.verdict in ("consistent", "recalibrate")
    assert found.fit.heldout_after == pytest.approx(found.fit.noise, rel=0.03)
    assert any(one.smallest is not None for one in found.not_found)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_thermal_lag_is_found_alone_and_with_its_time_constant() -> None:
    plain = draw("null", 4)
    truth = Truth(kind="single", bench=plain.bench, plan=plain.plan, effects={"thermal_lag": {"tau_s": 240.0}})
    found = diagnose(_recorded(truth, 4))
    assert [one.effect for one in found.findings] == ["thermal_lag"]
    tau = found.findings[0].parameters["tau_s"]
    assert tau.value == pytest.approx(240.0, rel=0.1)
    assert found.fit.heldout_after < found.fit.heldout_before


def test_of_a_short_recording_it_finds_what_is_missing_and_nothing_where_nothing_is(tmp_path: Path) -> None:
    for squared_v, effects in ((0.0, []), (2e-6, ["rate_squared"])):
        path = write_moving(tmp_path / f"{squared_v}.h5", squared_v=squared_v, kinds=KINDS * 2)
        with open_recording(path) as recording:
            found = diagnose(recording)
        assert [one.effect for one in found.findings] == effects
        assert found.verdict == ("missing-physics" if effects else "consistent")


def test_a_part_whose_channels_were_not_recorded_is_refused_in_one_line(tmp_path: Path) -> None:
    with (
        open_recording(write_moving(tmp_path / "gyro.h5")) as recording,
        pytest.raises(UsageError, match="no step has the channels encoder_deg, torque_nm together"),
    ):
        diagnose(recording, part="drive")


@pytest.mark.slow
@pytest.mark.timeout(600)
@needs_shared("checks")
def test_the_three_open_examples_come_out_right() -> None:
    command = [sys.executable, "-m", "benchctl", "diagnose", "{rec}", "--json", "{out}", "--quiet"]
    check = subprocess.run(
        [sys.executable, str(SHARED / "checks" / "diagnosis.py"), *command], capture_output=True, text=True, check=False
    )
    assert check.returncode == 0, check.stdout
    assert json.dumps(check.stdout).count("right") == 3


LINEAR = {"K0_v_per_dps": 0.05, "U0_v": 0.0, "T0_c": 20.0, "k_T": [], "k_omega": []}


def _turning(samples: int, *, shake_deg: float = 0.0, gyro_v: float | None = None) -> Recording:
    """A swing of 20 deg at 0.2 Hz, 500 samples a second, shaken at 170 Hz, and a gyro's volts or a constant."""
    time_s = np.arange(samples) / 500.0
    turn = 2.0 * np.pi * time_s
    noise = 0.01 * np.random.default_rng(1).standard_normal(samples)
    gyro: npt.NDArray[np.float64] = 0.05 * 8.0 * np.pi * np.cos(0.2 * turn) + noise
    channels = {
        "time_s": time_s,
        "encoder_deg": 20.0 * np.sin(0.2 * turn) + shake_deg * np.sin(170.0 * turn),
        "gyro_v": gyro if gyro_v is None else np.full(samples, gyro_v),
    }
    return recording_of(channels)


@pytest.mark.parametrize("rows", [4000, 8000])
def test_motion_beyond_the_filters_band_is_no_physics_however_short_the_recording(rows: int) -> None:
    """Of the shorter one the low pass would leave no row: it is compared whole."""
    assert diagnose(_turning(rows, shake_deg=2.0), model=LINEAR).verdict == "consistent"


@pytest.mark.parametrize("gyro_v", [0.0, 0.25, 25.0])
def test_a_gyro_whose_output_never_changes_is_refused_in_one_line(gyro_v: float) -> None:
    with pytest.raises(UsageError, match=rf"gyro_v is {gyro_v:g} in all .* rows; check that the gyro is powered"):
        diagnose(_turning(5000, gyro_v=gyro_v), model=LINEAR)


def test_a_table_at_rest_under_a_gyro_of_unknown_range_is_refused_in_one_line() -> None:
    noise = np.random.default_rng(1).standard_normal(3000)
    channels = {"time_s": np.arange(3000) / 500.0, "encoder_deg": np.full(3000, 5.0), "gyro_v": noise}
    with pytest.raises(UsageError, match="the table rests and the unit's range is not known; state range_dps"):
        diagnose(recording_of(channels), model=LINEAR)


SERVO_MAP = """
[unit]
serial = "IMU"
range_dps = 250
[file]
delimiter = " "
header_line = 0
[time]
column = 1
unit = "s"
stamps = "keep"
[channels.encoder_deg]
column = 5
unit = "rad"
[channels.gyro_v]
column = 2
unit = "rad/s"
"""


@pytest.mark.slow
@pytest.mark.timeout(300)
@needs_shared("data/servo_mount")
@pytest.mark.parametrize(
    ("name", "lag", "lives_in"),
    [("10_22_1.dat", "mount_resonance", "acceleration"), ("10_22_4.dat", "timing_offset", "rate")],
)
def test_eight_seconds_of_a_servo_are_imported_and_what_nobody_can_name_is_said(
    name: str, lag: str, lives_in: str, tmp_path: Path
) -> None:
    (tmp_path / "map.toml").write_text(SERVO_MAP, encoding="utf-8")
    path = tmp_path / "servo.h5"
    command = ["import", str(SHARED / "data/servo_mount" / name), "--map", str(tmp_path / "map.toml"), "-o", str(path)]
    subprocess.run([sys.executable, "-m", "benchctl", *command], check=True, capture_output=True)
    model = LINEAR | {"K0_v_per_dps": 1.0}
    with open_recording(path) as recording:
        found = diagnose(recording, model=model)
    (late,) = found.findings
    assert late.effect == lag
    assert "sensor_bandwidth" in {one.effect for one in late.alternatives}  # one sine does not separate it from a delay
    assert found.unexplained.significant
    assert lives_in in found.unexplained.says
    assert found.not_found == ()
    assert found.next_experiment.procedure
    assert found.fit.heldout_after <= 1.001 * found.fit.heldout_before
