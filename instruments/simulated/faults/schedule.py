"""When a fault happens: a rule over the operations of one link or instrument, and the counting that goes with it.

An operation is what is asked at once: a request on a link, a packet of a stream, one look at a machine. The same
operations at the same bench times fire the same faults, whoever asks and however fast.
"""

from __future__ import annotations

import math
import re
import threading
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Fired:
    """One fault that happened: bench time [s], where ("chamber", "digitizer_stream", ...), its kind, the operation."""

    bench_s: float
    where: str
    kind: str
    operation: str


class FaultLog:
    """The faults that have happened, oldest first; safe from any thread."""

    def __init__(self) -> None:
        self._fired: list[Fired] = []
        self._lock = threading.Lock()

    def note(self, fired: Fired) -> None:
        """Keep one more."""
        with self._lock:
            self._fired.append(fired)

    @property
    def fired(self) -> tuple[Fired, ...]:
        """All so far."""
        with self._lock:
            return tuple(self._fired)


@dataclass(frozen=True, slots=True, kw_only=True)
class When:
    """The operations at which a fault happens; all that is said must hold.

    Parameters
    ----------
    pattern
        Only operations in whose text this regular expression is found; the conditions below count these alone. How an
        operation reads is a matter of its wire: `benchctl_instruments.simulated.faults.wires`.
    from_s, to_s
        Only from this bench time on, and before that one.
    nth
        Only the nth of these, from 1.
    every
        Every nth of these: the 3rd, 6th, 9th, ... where it is 3.
    every_s
        The first of these in each stretch of so much bench time, counted from `from_s`.
    times
        At most so often.
    """

    pattern: str = ""
    from_s: float = 0.0
    to_s: float = math.inf
    nth: int | None = None
    every: int | None = None
    every_s: float | None = None
    times: int | None = None


class Schedule:
    """Counts operations against one `When`; not safe from several threads by itself.

    Attributes
    ----------
    fired
        How often the fault has happened.
    """

    def __init__(self, when: When) -> None:
        self.fired = 0
        self._when = when
        self._pattern = re.compile(when.pattern)
        self._counted = 0
        self._stretch = -1  # the last one in which the fault happened

    def fires(self, operation: str, now_s: float) -> bool:
        """Take the next operation into account: its text, and the bench time; whether the fault happens at it."""
        when = self._when
        if not when.from_s <= now_s < when.to_s or not self._pattern.search(operation):
            return False
        self._counted += 1
        if when.nth is not None and self._counted != when.nth:
            return False
        if when.every is not None and self._counted % when.every:
            return False
        if when.times is not None and self.fired >= when.times:
            return False
        if when.every_s is not None:
            stretch = math.floor((now_s - when.from_s) / when.every_s)
            if stretch <= self._stretch:
                return False
            self._stretch = stretch
        self.fired += 1
        return True
