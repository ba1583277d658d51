"""The inputs of a simulated digital gyro, on a clock that the test turns by hand or on the wall's."""

from __future__ import annotations

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.physics.gyro import GyroParameters
from benchctl_instruments.simulated.clock import BenchClock
from benchctl_instruments.simulated.settings import WorldSettings

SETTINGS = WorldSettings(gyro=GyroParameters(K0_v_per_dps=0.05, U0_v=0.25), thermistor_offset_v=-0.5)


class RampInputs:
    """A rate that starts at `rate_dps` and goes up by `ramp_dps2`, at 21.75 °C."""

    def __init__(self, clock: BenchClock, *, rate_dps: float = 0.0, ramp_dps2: float = 0.0) -> None:
        self.clock = clock
        self.rate_dps, self.ramp_dps2 = rate_dps, ramp_dps2
        self.held_since_s: float | None = None
        self.first_sampled_s: float | None = None

    def now(self) -> float:
        return self.clock.now()

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        return self.clock.wait_until(bench_time_s, timeout_s)

    def hold_history(self, since_s: float | None) -> None:
        self.held_since_s = since_s

    def sample(
        self, first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        times_s = first_s + np.arange(start, start + scans, dtype=np.float64) * interval_s
        assert times_s[-1] <= self.now() + 2e-9, "sampled in the future"
        if self.first_sampled_s is None:
            self.first_sampled_s = first_s + start * interval_s
        rate_dps = self.rate_dps + self.ramp_dps2 * times_s
        volts = SETTINGS.gyro.U0_v + SETTINGS.gyro.K0_v_per_dps * rate_dps
        thermistor_v = np.full(scans, SETTINGS.thermistor_offset_v + SETTINGS.thermistor_v_per_c * 21.75)
        return np.zeros(scans, np.int64), volts, thermistor_v
