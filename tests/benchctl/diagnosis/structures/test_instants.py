"""What happens at an instant is found where it happens, also within a step that is kept back for the proof."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchctl.diagnosis import diagnose
from benchctl.recordings.reader import open_recording
from tests.benchctl.diagnosis.moving import KINDS, write_moving


def test_a_step_of_the_bias_within_a_step_that_is_held_out_is_found_at_its_instant(tmp_path: Path) -> None:
    # of each kind the fourth is held out: 90 to 118 s, and nothing was recorded just before
    path = write_moving(tmp_path / "moving.h5", kinds=8 * KINDS, rate_hz=100.0, later_v=(104.0, 2e-3))
    with open_recording(path) as recording:
        told = diagnose(recording).as_json()
    model = told["unexplained"]["model"]
    assert (model["stage"], model["coordinates"], model["shape"]) == ("bias", ["time"], "step")
    assert model["parameters"]["at"]["value"] == pytest.approx(104.0, abs=0.5)
    assert model["parameters"]["change"]["value"] == pytest.approx(2e-3, rel=0.02)
    low, high = model["parameters"]["at"]["ci95"]
    assert 0.0 < high - low < 1.0
    assert told["findings"] == []
    assert told["fit"]["heldout_after"] < 1.05 * told["fit"]["noise"]
