"""Structures in recordings made by a formula: found at their place, and no name stands for them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.diagnosis import diagnose
from benchctl.recordings.reader import open_recording
from tests.benchctl.diagnosis.moving import K0, KINDS, write_moving

FloatArray = npt.NDArray[np.float64]
More = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def model_of(path: Path, more_v: More) -> Any:
    """The only thing that a diagnosis finds, in a coil that warms by 40 °C and cools again."""

    def coil_c(time_s: FloatArray) -> FloatArray:
        return 23.0 + 40.0 * np.sin(2.0 * np.pi * time_s / 240.0)

    write_moving(path, kinds=8 * KINDS, rate_hz=100.0, more_v=more_v, coil_c=coil_c)
    with open_recording(path) as recording:
        told = diagnose(recording).as_json()
    assert told["findings"] == []
    assert told["fit"]["heldout_after"] < 1.05 * told["fit"]["noise"]
    assert "further" not in told["unexplained"]
    return told["unexplained"]["model"]


@pytest.mark.slow
def test_a_step_of_the_bias_within_a_step_that_is_held_out_is_found_at_its_instant(tmp_path: Path) -> None:
    # of each kind the fourth is held out: 90 to 118 s, and nothing was recorded just before
    model = model_of(tmp_path / "moving.h5", lambda time_s, _rate_dps, _coil_c: 2e-3 * (time_s > 104.0))
    assert (model["stage"], model["coordinates"], model["shape"]) == ("bias", ["time"], "step")
    assert model["parameters"]["at"]["value"] == pytest.approx(104.0, abs=0.5)
    assert model["parameters"]["change"]["value"] == pytest.approx(2e-3, rel=0.02)
    low, high = model["parameters"]["at"]["ci95"]
    assert 0.0 < high - low < 1.0


@pytest.mark.slow
def test_a_root_of_the_bias_over_the_temperature_is_not_told_as_its_polynomial(tmp_path: Path) -> None:
    model = model_of(
        tmp_path / "moving.h5", lambda _time_s, _rate_dps, coil_c: 1e-3 * np.sqrt(np.maximum(coil_c - 20.0, 0.0))
    )
    assert (model["stage"], model["coordinates"], model["shape"]) == ("bias", ["gyro_temp"], "power")
    assert model["parameters"]["at"]["value"] == pytest.approx(20.0, abs=0.2)
    assert model["parameters"]["exponent"]["value"] == pytest.approx(0.5, abs=0.02)
    assert model["parameters"]["high"]["ci95"] == [model["parameters"]["high"]["value"]] * 2


@pytest.mark.slow
def test_a_kink_of_the_scale_factor_over_the_rate_is_not_told_as_two_nonlinearities(tmp_path: Path) -> None:
    def more_v(_time_s: FloatArray, rate_dps: FloatArray, _coil_c: FloatArray) -> FloatArray:
        return K0 * rate_dps * 3e-4 * np.maximum(np.abs(rate_dps) - 25.0, 0.0)

    model = model_of(tmp_path / "moving.h5", more_v)
    assert (model["stage"], model["coordinates"], model["shape"]) == ("scale", ["abs_rate"], "kink")
    assert model["parameters"]["at"]["value"] == pytest.approx(25.0, abs=1.0)
