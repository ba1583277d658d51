"""What a digitizer's terminals see, as plain functions of bench time, on whatever clock."""

from __future__ import annotations

import threading

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.simulated.clock import BenchClock


class FakeInputs:
    """The count goes up steadily from `first_count`; the gyro gives a slow ramp, the thermistor a constant."""

    def __init__(self, clock: BenchClock, *, first_count: int = 0, counts_per_s: float = 1000.0) -> None:
        self.clock = clock
        self.first_count, self.counts_per_s = first_count, counts_per_s
        self.held_since_s: float | None = None
        self.calls: list[tuple[float, float, int]] = []
        self._lock = threading.Lock()

    def now(self) -> float:
        return self.clock.now()

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        return self.clock.wait_until(bench_time_s, timeout_s)

    def hold_history(self, since_s: float | None) -> None:
        self.held_since_s = since_s

    def sample(
        self, first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        with self._lock:
            self.calls.append((first_s + start * interval_s, interval_s, scans))
        times_s = first_s + np.arange(start, start + scans, dtype=np.float64) * interval_s
        assert times_s[-1] <= self.now() + 2e-9, "sampled in the future"
        return self.counts(times_s), self.gyro_v(times_s), np.full(scans, 0.25)

    def counts(self, times_s: FloatArray) -> IntArray:
        """The true count."""
        return self.first_count + np.floor(times_s * self.counts_per_s + 1e-6).astype(np.int64)

    def gyro_v(self, times_s: FloatArray) -> FloatArray:
        """The true gyro volts, a ramp that comes back every 100 s."""
        return times_s % 100.0 / 10.0 - 5.0
