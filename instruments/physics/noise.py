"""Random processes of the sensor: white noise, and a random walk sampled at any increasing instants."""

from __future__ import annotations

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError


class WhiteNoise:
    """Independent normal samples; the series does not depend on how it is divided into draws."""

    def __init__(self, seed: np.random.SeedSequence) -> None:
        self._generator = np.random.default_rng(seed)

    def draw(self, samples: int, deviation: float) -> FloatArray:
        """Return the next samples, shape (samples,), with a standard deviation."""
        values = self._generator.standard_normal(samples)
        values *= deviation
        return values


class RandomWalk:
    """Integrated white noise B, zero at time zero: increments over disjoint times are independent, variance q²·Δt.

    Exact at the sampled instants for any spacing, and continuous between calls. `last_s` is the last sampled instant.
    """

    def __init__(self, seed: np.random.SeedSequence, per_sqrt_s: float) -> None:
        self._generator = np.random.default_rng(seed)
        self._per_sqrt_s = per_sqrt_s
        self.last_s = 0.0
        self._value = 0.0

    def at(self, times_s: FloatArray) -> FloatArray:
        """Return the walk at instants [s], shape (n,), n ≥ 1, increasing and none before the last sampled instant."""
        waits_s = np.empty_like(times_s)
        waits_s[0] = times_s[0] - self.last_s
        np.subtract(times_s[1:], times_s[:-1], out=waits_s[1:])
        if waits_s.min() < 0.0:
            raise UsageError(
                f"a random walk was requested at {times_s[waits_s.argmin()]:.6f} s after {self.last_s:.6f} s;"
                " ask in the order of time"
            )
        steps = np.sqrt(waits_s, out=waits_s)
        steps *= self._generator.standard_normal(times_s.size)
        steps *= self._per_sqrt_s
        steps[0] += self._value
        walk = np.cumsum(steps, out=steps)
        self.last_s, self._value = float(times_s[-1]), float(walk[-1])
        return walk
