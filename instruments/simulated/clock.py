"""The simulated bench's time: a clock that jumps, one that runs at a multiple of wall time, and what its parts share.

Both clocks satisfy `interfaces.Clock`; they also let a simulated instrument wait for an instant of bench time. The
parts of the bench share the clock, one lock, the internal grid and a horizon of memory.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Protocol

from benchctl_instruments.errors import UsageError


class BenchClock(Protocol):
    """`benchctl_instruments.interfaces.Clock` with something to wait on, for what runs beside the host's own thread."""

    def now(self) -> float:
        """Seconds of bench time since the clock was made; never goes back."""

    def sleep(self, seconds: float) -> None:
        """Let that much bench time pass."""

    @property
    def chunk_s(self) -> float:
        """How much bench time may pass between two looks at the bench."""

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until an instant of bench time, at most `timeout_s` of wall time; whether it has come."""


class VirtualClock:
    """Bench time that passes only while somebody sleeps, and then at once; hours of soak cost nothing."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._moved = threading.Condition()

    def now(self) -> float:
        """Seconds of bench time."""
        return self._now_s  # one number, so a reader beside a jump sees the time before it or after it

    def sleep(self, seconds: float) -> None:
        """Jump ahead by `seconds` and wake whoever waits."""
        _refuse_the_past(seconds)
        with self._moved:
            self._now_s += seconds
            self._moved.notify_all()

    @property
    def chunk_s(self) -> float:
        """Seconds of bench time between two looks at the bench."""
        return 5.0

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until some other thread's sleep has reached the instant, at most `timeout_s` of wall time."""
        with self._moved:
            return self._moved.wait_for(lambda: self._now_s >= bench_time_s, timeout_s)


class ScaledClock:
    """Bench time that runs `factor` times as fast as the wall's."""

    def __init__(self, factor: float = 1.0) -> None:
        if not 0.0 < factor < float("inf"):
            raise UsageError(f"a clock cannot run {factor} times as fast as the wall's; give a finite factor above 0")
        self._factor = factor
        self._start_s = time.monotonic()

    def now(self) -> float:
        """Seconds of bench time."""
        return (time.monotonic() - self._start_s) * self._factor

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of bench time, `seconds / factor` by the wall."""
        _refuse_the_past(seconds)
        time.sleep(seconds / self._factor)

    @property
    def chunk_s(self) -> float:
        """Seconds of bench time between two looks at the bench: half a second by the wall."""
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
"""How much more than is asked for is remembered: what the gyro's electronics need, and callers that are late."""


class Timebase:
    """Bench time on a grid of `grid_hz`; sample k of the grid lies at k / grid_hz.

    Demands take effect at the next instant of the grid, so that nothing which was already computed up to there changes.
    Whoever reads or changes the bench holds `lock`. `reach_s` is how much further back than `MARGIN_S` the terminals
    may have to look.
    """

    def __init__(self, clock: BenchClock, grid_hz: float) -> None:
        self.clock = clock
        self.grid_hz = grid_hz
        self.lock = threading.RLock()
        self.held_since_s: float | None = None
        self.reach_s = 0.0
        self._beside: list[Timebase] = []

    def now(self) -> float:
        """Bench time [s]."""
        return self.clock.now()

    def next_instant(self) -> float:
        """The first instant of the grid that is not past [s]."""
        return math.ceil(self.now() * self.grid_hz) / self.grid_hz

    def beside(self) -> Timebase:
        """The same time for a second reader, who holds and looks back by itself."""
        other = Timebase(self.clock, self.grid_hz)
        other.lock = self.lock
        self._beside.append(other)
        return other

    def forgettable_s(self) -> float:
        """Nobody will ask for anything before this instant [s]."""
        now = self.now()
        held = now if self.held_since_s is None else min(self.held_since_s, now)
        return min([held - MARGIN_S - self.reach_s, *(other.forgettable_s() for other in self._beside)])
