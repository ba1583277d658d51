from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.diagnosis.gyro.frame import frame_of
from benchctl.diagnosis.gyro.limits import limits_of
from benchctl.recordings.reader import open_recording
from tests.benchctl.diagnosis.moving import write_moving

MODEL = {"K0_v_per_dps": 0.05, "T0_c": 20.0, "noise_v_rms": 6e-4}


@pytest.mark.parametrize(("counts", "said"), [(65_536, True), (360_000, True), (3_600_000, False), (0, False)])
def test_an_encoder_is_said_to_be_coarse_where_its_steps_outdo_the_noise(
    tmp_path: Path, counts: int, said: bool
) -> None:
    with open_recording(write_moving(tmp_path / "r.h5")) as recording:
        frame = frame_of(recording)
    sentences = limits_of(frame, MODEL, None, 360.0 / counts if counts else 0.0)
    assert any("beat with the samples" in one for one in sentences) == said
