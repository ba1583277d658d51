from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.comparison.pairing import with_predictions, with_recording
from benchctl.diagnosis.comparison.parting import part
from benchctl.diagnosis.gyro.frame import Frame, frame_of
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.diagnosis.moving import K0, NOISE_V, RATE_DPS, write_moving


def frame(path: Path) -> Frame:
    with open_recording(path) as recording:
        return frame_of(recording)


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Frame:
    return frame(write_moving(tmp_path_factory.mktemp("real") / "real.h5"))


@pytest.mark.parametrize("rate_hz", [200.0, 160.0])
def test_the_same_gyro_in_a_sine_of_another_phase_does_not_differ(real: Frame, tmp_path: Path, rate_hz: float) -> None:
    other = frame(write_moving(tmp_path / "other.h5", phase=1.1, seed=1, rate_hz=rate_hz))
    steps, alone = with_recording(real, other, "other")
    assert alone == []
    found = part(steps)
    assert [step.kind for step in found.steps] == ["static", "constant_rate", "sine"]
    assert found.rms_v["other"] == pytest.approx(np.sqrt(2) * NOISE_V, rel=0.05)
    assert abs(found.steps[2].mean_v["other"]) < 5 * NOISE_V / np.sqrt(400)


def test_a_sine_is_laid_on_its_nearest_likeness(real: Frame, tmp_path: Path) -> None:
    other = frame(write_moving(tmp_path / "other.h5", phase=0.4, seed=1))
    steps, _ = with_recording(real, other, "other")
    shift = 0.4 / np.pi / 2 / 0.5 * 200  # samples; a period is 400
    assert steps[2].time_s.size == pytest.approx(1600 - shift, abs=2)


def test_another_scale_factor_shows_along_the_rate(real: Frame, tmp_path: Path) -> None:
    other = frame(write_moving(tmp_path / "other.h5", K0_v_per_dps=K0 * 0.998, phase=2.0, seed=1))
    found = part(with_recording(real, other, "other")[0])
    assert found.steps[1].mean_v["other"] == pytest.approx(0.002 * K0 * RATE_DPS, rel=0.05)
    along = next(one for one in found.coordinates if one.coordinate == "rate")
    middle = (along.edges[1:] + along.edges[:-1]) / 2
    held = along.count > 0
    slope = np.polyfit(middle[held], along.mean_v["other"][held], 1, w=np.sqrt(along.count[held]))[0]
    assert slope == pytest.approx(0.002 * K0, rel=0.05)


def test_a_step_that_only_one_recording_has_is_named(real: Frame, tmp_path: Path) -> None:
    other = frame(write_moving(tmp_path / "other.h5", kinds=("constant_rate", "sine", "sine"), seed=1))
    steps, alone = with_recording(real, other, "other")
    assert [step.kind for step in steps] == ["constant_rate", "sine"]
    assert alone == ["only in the real one: static at +23", "only in the simulated one: sine at +23"]


def test_recordings_that_share_no_step_are_refused(tmp_path: Path) -> None:
    one = frame(write_moving(tmp_path / "one.h5", kinds=("static", "static")))
    other = frame(write_moving(tmp_path / "other.h5", kinds=("sine", "sine")))
    with pytest.raises(UsageError, match=r"share no step: one has static at \+23"):
        with_recording(one, other, "other")


def test_predictions_stand_beside_every_step(real: Frame) -> None:
    steps = with_predictions(real, {"none": np.zeros(real.rows), "same": real.volts})
    assert sum(step.measured_v.size for step in steps) == real.rows
    assert all(np.all(step.difference("same") == 0.0) for step in steps)
    assert np.array_equal(steps[2].difference("none"), real.volts[real.step == 2])
    assert set(steps[0].coordinates) == {"time", "rate", "acceleration", "angle", "gyro_temp", "output"}
