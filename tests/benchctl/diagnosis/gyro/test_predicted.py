from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.gyro.frame import Frame
from benchctl.diagnosis.gyro.predicted import predict
from benchctl.recordings.reader import open_recording
from benchctl.signals.rate import half_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis.moving import NOISE_V, RATE_DPS, SIMULATION, write_moving


def test_the_model_that_made_a_recording_predicts_it_to_its_noise(tmp_path: Path) -> None:
    with open_recording(write_moving(tmp_path / "r.h5", squared_v=1e-5)) as recording:
        frame, volts = predict(recording, {"simulation": SIMULATION, "effects": {"rate_squared": {"v_per_dps2": 1e-5}}})
        _, without = predict(recording, {"simulation": SIMULATION})
    assert _inner(frame, frame.volts - volts) == pytest.approx(NOISE_V, rel=0.03)
    turning = frame.step == 1
    assert np.mean((frame.volts - without)[turning]) == pytest.approx(1e-5 * RATE_DPS**2, rel=0.01)


def test_a_model_without_rate_and_temperature_terms_need_not_name_them(tmp_path: Path) -> None:
    short = {name: SIMULATION[name] for name in ("K0_v_per_dps", "U0_v", "T0_c")}
    with open_recording(write_moving(tmp_path / "r.h5")) as recording:
        frame, volts = predict(recording, {"simulation": short})
    assert _inner(frame, frame.volts - volts) == pytest.approx(NOISE_V, rel=0.03)


def test_noise_is_not_predicted(tmp_path: Path) -> None:
    noisy = {"simulation": SIMULATION, "effects": {"bias_random_walk": {"v_per_sqrt_s": 1.0}}}
    with open_recording(write_moving(tmp_path / "r.h5")) as recording:
        frame, volts = predict(recording, noisy)
    assert _inner(frame, frame.volts - volts) == pytest.approx(NOISE_V, rel=0.03)


def test_a_model_that_says_nothing_of_the_gyro_is_refused(tmp_path: Path) -> None:
    with (
        open_recording(write_moving(tmp_path / "r.h5")) as recording,
        pytest.raises(UsageError, match=r"no \[simulation\]"),
    ):
        predict(recording, {"effects": {}})


def _inner(frame: Frame, residual: FloatArray) -> float:
    """Deviation of a residual where no filter of the motion reaches beyond the ends of a stretch."""
    half = half_of(1.0 / frame.interval_s)
    return float(np.std(np.concatenate([residual[part][half:-half] for part in frame.stretches])))
