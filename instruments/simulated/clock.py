"""Time of the simulated bench: a virtual clock, a clock at a multiple of wall time, and the time base of all parts.

Both clocks implement `interfaces.Clock`; they also let a simulated instrument wait for an instant of bench time. The
parts of the bench share the clock, one lock, the internal grid and the length of the history.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Protocol

from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Clock


class BenchClock(Clock, Protocol):
    """A clock on which other threads than the host's can wait."""

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until an instant of bench time, at most `timeout_s` of wall time; return whether it was reached."""


class VirtualClock:
    """Bench time that advances only by `sleep`, and then at once; hours of soak cost no time."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._moved = threading.Condition()

    def now(self) -> float:
        """Return the seconds of bench time."""
        return self._now_s  # a single number: a concurrent reader gets the time before or after a jump

    def sleep(self, seconds: float) -> None:
        """Advance by `seconds` and wake all waiting threads."""
        _refuse_the_past(seconds)
        with self._moved:
            self._now_s += seconds
            self._moved.notify_all()

    @property
    def chunk_s(self) -> float:
        """Longest bench time [s] between two checks of the bench."""
        return 5.0

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until another thread's sleep has reached the instant, at most `timeout_s` of wall time."""
        with self._moved:
            return self._moved.wait_for(lambda: self._now_s >= bench_time_s, timeout_s)


class ScaledClock:
    """Bench time that runs `factor` times as fast as wall time."""

    def __init__(self, factor: float = 1.0) -> None:
        if not 0.0 < factor < float("inf"):
            raise UsageError(f"a clock cannot run {factor} times as fast as the wall's; give a finite factor above 0")
        self._factor = factor
        self._start_s = time.monotonic()

    def now(self) -> float:
        """Return the seconds of bench time."""
        return (time.monotonic() - self._start_s) * self._factor

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of bench time, `seconds / factor` of wall time."""
        _refuse_the_past(seconds)
        time.sleep(seconds / self._factor)

    @property
    def chunk_s(self) -> float:
        """Longest bench time [s] between two checks of the bench: half a second of wall time."""
        return 0.5 * self._factor

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until the instant, at most `timeout_s` of wall time."""
        give_up_s = time.monotonic() + timeout_s
        while (left_s := (bench_time_s - self.now()) / self._factor) > 0.0:
            patience_s = give_up_s - time.monotonic()
            if patience_s <= 0.0:
                return False
            time.sleep(min(left_s, patience_s))
        return True


def _refuse_the_past(seconds: float) -> None:
    if not 0.0 <= seconds < float("inf"):
        raise UsageError(f"cannot let {seconds} s of bench time pass; give a finite time, zero or more")


MARGIN_S = 60.0
"""Length of the history before the held instant: for the gyro's electronics, and for late callers."""


class Timebase:
    """Bench time on a grid of `grid_hz`; sample k of the grid is at k / grid_hz.

    Demands take effect at the next instant of the grid, so that results computed up to there remain valid. Hold `lock`
    while reading or changing the bench. `reach_s` is the time before `MARGIN_S` that the terminals may additionally
    need.
    """

    def __init__(self, clock: BenchClock, grid_hz: float) -> None:
        self.clock = clock
        self.grid_hz = grid_hz
        self.lock = threading.RLock()
        self.held_since_s: float | None = None
        self.reach_s = 0.0
        self._others: list[Timebase] = []

    def now(self) -> float:
        """Return the bench time [s]."""
        return self.clock.now()

    def next_instant(self) -> float:
        """Return the first instant of the grid that is not in the past [s]."""
        return math.ceil(self.now() * self.grid_hz) / self.grid_hz

    def second(self) -> Timebase:
        """Return a time base with the same clock for a second reader, which holds its own history."""
        other = Timebase(self.clock, self.grid_hz)
        other.lock = self.lock
        self._others.append(other)
        return other

    def forgettable_s(self) -> float:
        """Return the instant [s] before which no history is needed."""
        now = self.now()
        held = now if self.held_since_s is None else min(self.held_since_s, now)
        return min([held - MARGIN_S - self.reach_s, *(other.forgettable_s() for other in self._others)])
