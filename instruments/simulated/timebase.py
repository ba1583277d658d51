"""What the parts of the simulated bench share: the clock, one lock, the internal grid and a horizon of memory."""

from __future__ import annotations

import math
import threading

from benchctl_instruments.simulated.clock import BenchClock

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
