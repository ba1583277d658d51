"""A low-pass of a stretch that begins and ends in the middle of a swing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.recordings.reader import open_recording
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth
from tests.benchctl.diagnosis.moving import K0, PEAK_DPS, SINE_HZ, U0, write_moving


@settings(max_examples=10, deadline=None)
@given(phase=st.floats(0.0, 6.28))
def test_its_end_does_not_ring(tmp_path_factory: pytest.TempPathFactory, phase: float) -> None:
    path: Path = write_moving(tmp_path_factory.mktemp("swing") / "swing.h5", phase=phase, kinds=("sine", "sine"))
    with open_recording(path) as recording:
        problem = gyro_problem(recording)
    cutoff_hz = 60.0
    predicted = problem.predict(problem.baseline_start, (SensorBandwidth(cutoff_hz=cutoff_hz, order=1.0),))
    plain = problem.predict(problem.baseline_start, ())
    part = problem.frame.stretches[-1]
    # of slow motion a low-pass makes what was, a time constant ago
    time_s = problem.time_s[part]
    expected = np.interp(time_s - 1 / (2 * np.pi * cutoff_hz), time_s, plain[part])
    inside = slice(32, -32)
    assert predicted[part][inside] == pytest.approx(expected[inside], abs=3e-4 * K0 * PEAK_DPS)
    assert np.abs(np.diff(predicted[part][inside], 2)).max() < 3 * K0 * PEAK_DPS * (2 * np.pi * SINE_HZ / 200.0) ** 2
    assert abs(predicted[part].mean() - U0) < 0.1
