"""Recordings that are diagnosed jointly: in each, time and what the gyro remembers begin anew."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.recordings.reader import join, open_recording
from benchctl_instruments.physics.effects.clock_drift import ClockDrift
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.scale_ageing import ScaleAgeing
from benchctl_instruments.physics.effects.thermal_lag import ThermalLag
from benchctl_instruments.physics.effects.warm_up import WarmUp
from tests.benchctl.diagnosis.moving import write_moving


@pytest.mark.parametrize(
    "effect",
    [
        WarmUp(amplitude_v=0.1, tau_s=10.0),
        ScaleAgeing(per_hour=0.1),
        ClockDrift(ppm=500.0),
        ThermalLag(tau_s=500.0),
    ],
    ids=lambda one: one.identifier,
)
def test_an_effect_says_of_each_recording_what_it_says_of_it_alone(tmp_path: Path, effect: PhysicalEffect) -> None:
    with ExitStack() as stack:
        names = ("one.h5", "other.h5", "third.h5")
        paths = [write_moving(tmp_path / name, seed=seed) for seed, name in enumerate(names)]
        recordings = [stack.enter_context(open_recording(path)) for path in paths]
        alone = [gyro_problem(recording) for recording in recordings]
        jointly = gyro_problem(join([join(recordings[:2]), recordings[2]]))
        apart = np.concatenate([one.predict(one.baseline_start, (effect,)) for one in alone])
        assert jointly.predict(jointly.baseline_start, (effect,)) == pytest.approx(apart, abs=2e-6)
        assert len(set(jointly.frame.origins_s)) == 3
