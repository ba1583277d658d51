"""A recording whose temperature ramps up and down while the table turns, with sines in between."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.writer import write_recording
from tests.benchctl.diagnosis.moving import K0, SIMULATION, T0, U0

RATE_HZ, SOAK_S, SINE_S, STEPS = 100.0, 240.0, 20.0, 12


def recorded(path: Path) -> Path:
    """Ramps of the temperature, up and down, in which the table turns at a rate; sines between them."""
    steps, start_s, temp_c, angle_deg = [], 0.0, T0, 0.0
    for index in range(1, STEPS + 1):
        ramp = index % 2 == 1
        time_s = np.arange(0.0, SOAK_S if ramp else SINE_S, 1.0 / RATE_HZ)
        angle = angle_deg + (30.0 * time_s if ramp else 20.0 * (1.0 - np.cos(np.pi * time_s)))
        temp = temp_c + 0.05 * time_s * (1.0 if index % 4 == 1 else -1.0) * ramp
        rate = np.gradient(angle, time_s)
        channels = {
            "time_s": start_s + time_s,
            "encoder_deg": np.mod(angle, 360.0),
            "gyro_v": U0 + K0 * rate + 5e-4 * np.random.default_rng(index).standard_normal(time_s.size),
            "gyro_temp_c": temp,
        }
        ends_s, temp_c, angle_deg = start_s + float(time_s[-1]), float(temp[-1]), float(angle[-1])
        name, kind = f"{index}", "constant_rate" if ramp else "sine"
        info = StepInfo(
            index=index,
            name=name,
            kind=kind,
            t_start=start_s,
            t_end=ends_s,
            chamber_setpoint_c=T0,
            sample_rate_hz=RATE_HZ,
        )
        steps.append(Step(info, channels))
        start_s = ends_s + 1.0 / RATE_HZ + (5.0 if index % 3 == 0 else 0.0)
    simulation = {**SIMULATION, "k_T": [1e-3]}
    meta = Meta(
        status="complete",
        unit=Unit(serial="G-1", range_dps=100.0),
        bench=BenchFacts(sample_rate_hz=RATE_HZ, encoder_counts_per_rev=4194304),
        simulation=simulation,
    )
    write_recording(path, meta, steps)
    return path
