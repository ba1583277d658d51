"""A slow recording of a gyro whose samples are late, as a problem, and the pair of models that it leaves open."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchctl.bench import SIMULATED, Bench, load_bench
from benchctl.diagnosis.gyro.chain import GyroChain
from benchctl.diagnosis.gyro.problem import GyroProblem, gyro_problem
from benchctl.diagnosis.next_run.experiment import OpenPair
from benchctl.diagnosis.next_run.planned import planned
from benchctl.estimation.fit import Fit, Point, fit
from benchctl.estimation.noise import Whitener
from benchctl.plan import Plan, Sine, Static, Step
from benchctl.recordings.reader import open_recording
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.effects.sensor_bandwidth import SensorBandwidth
from benchctl_instruments.physics.effects.timing_offset import TimingOffset
from tests.benchctl.diagnosis.moving import NOISE_V, write_moving

LATE_S = 0.004
LATE = TimingOffset(offset_s=LATE_S)
SMOOTH = SensorBandwidth(cutoff_hz=np.sqrt(2.0) / (2 * np.pi * LATE_S), order=2.0)


def bench(**limits: float) -> Bench:
    """The simulated bench within other limits, at 100 samples a second."""
    stands = load_bench(SIMULATED)
    return stands.model_copy(
        update={
            "limits": stands.limits.model_copy(update=limits),
            "digitizer": stands.digitizer.model_copy(update={"sample_rate_hz": 100.0}),
        }
    )


def plan_of(*steps: Step) -> Plan:
    return Plan(procedure="made", parameters={}, steps=steps, calibrates=False)


def problem_of(folder: Path, effect: DescribedEffect = LATE, *steps: Step) -> GyroProblem:
    """A problem whose recording was made of a plan, by default of slow motion, by a gyro with an effect."""
    with open_recording(write_moving(folder / "moving.h5")) as recording:
        about = gyro_problem(recording)
    slow = (Static(duration_s=20.0), Sine(amplitude_dps=60.0, frequency_hz=0.5, cycles=20), Static(duration_s=20.0))
    rows = planned(plan_of(*(steps or slow)), bench())
    there = replace(
        about, frame=rows.frame, chain=GyroChain(rows.frame, about.chain.law), usable=rows.stands_for > 0.0, band=None
    )
    noise = NOISE_V * np.random.default_rng(1).standard_normal(rows.frame.rows)
    volts = there.predict(there.baseline_start, (effect,)) + noise
    return replace(there, frame=replace(rows.frame, volts=volts))


def whitener_of(problem: GyroProblem) -> Whitener:
    return Whitener(interval_s=problem.interval_s, weight=problem.usable.astype(np.float64))


def fitted(problem: GyroProblem, *effects: DescribedEffect) -> Fit:
    everything = np.ones(len(problem.step_names), np.bool_)
    return fit(problem, whitener_of(problem), Point(baseline=problem.baseline_start, effects=effects), everything)


def pair_of(problem: GyroProblem) -> OpenPair:
    """Late samples, or a low-pass."""
    return OpenPair(
        finding="timing_offset", rival="sensor_bandwidth", first=fitted(problem, LATE), second=fitted(problem, SMOOTH)
    )
