"""Short recordings of a gyro in known motion, written by a formula: at rest, at a rate, in a sine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.writer import write_recording

FloatArray = npt.NDArray[np.float64]

K0, U0, T0, NOISE_V = 0.02, 0.01, 23.0, 5e-4
SIMULATION = {
    "K0_v_per_dps": K0,
    "U0_v": U0,
    "T0_c": T0,
    "k_T": [],
    "k_omega": [],
    "noise_v_rms": NOISE_V,
    "output_limit_v": 5.0,
}
PEAK_DPS, SINE_HZ, RATE_DPS = 60.0, 0.5, 40.0
KINDS = ("static", "constant_rate", "sine")


def write_moving(
    path: Path,
    *,
    K0_v_per_dps: float = K0,
    squared_v: float = 0.0,
    more_v: Callable[[FloatArray, FloatArray, FloatArray], FloatArray] = lambda time_s, rate_dps, coil_c: 0.0 * time_s,
    coil_c: Callable[[FloatArray], FloatArray] = lambda time_s: np.full(time_s.size, T0),
    phase: float = 0.0,
    rate_hz: float = 200.0,
    kinds: Sequence[str] = KINDS,
    seed: int = 0,
    simulation: dict[str, object] | None = SIMULATION,
    serial: str = "G-1",
) -> Path:
    """Write U = U0 + K0·ω + v·ω² + noise; the sine begins at `phase` [rad].

    `more_v` of time, rate and coil temperature is added; `coil_c` is that temperature.
    """
    chance = np.random.default_rng(seed)
    steps, start_s = [], 0.0
    for index, kind in enumerate(kinds, 1):
        time_s = np.arange(0.0, 8.0, 1 / rate_hz)
        angle, rate = _motion(kind, time_s, phase)
        coil = coil_c(start_s + time_s)
        more = more_v(start_s + time_s, rate, coil)
        noise = NOISE_V * chance.standard_normal(time_s.size)
        channels = {
            "time_s": start_s + time_s,
            "encoder_deg": np.mod(angle, 360.0),
            "gyro_v": U0 + K0_v_per_dps * rate + squared_v * rate**2 + more + noise,
            "gyro_temp_c": coil,
        }
        info = StepInfo(
            index=index,
            name=f"{kind} at +23",
            kind=kind,
            t_start=start_s,
            t_end=start_s + 8.0,
            chamber_setpoint_c=T0,
            sample_rate_hz=rate_hz,
        )
        steps.append(Step(info, channels))
        start_s += 10.0
    meta = Meta(
        status="complete",
        unit=Unit(serial=serial, range_dps=100.0),
        bench=BenchFacts(sample_rate_hz=rate_hz, encoder_counts_per_rev=4194304),
        simulation=simulation,
    )
    write_recording(path, meta, steps)
    return path


def _motion(kind: str, time_s: FloatArray, phase: float) -> tuple[FloatArray, FloatArray]:
    omega = 2 * np.pi * SINE_HZ
    if kind == "sine":
        rate = PEAK_DPS * np.sin(omega * time_s + phase)
        return 100.0 - PEAK_DPS / omega * np.cos(omega * time_s + phase), rate
    dps = RATE_DPS if kind == "constant_rate" else 0.0
    return 30.0 + dps * time_s, np.full(time_s.size, dps)
