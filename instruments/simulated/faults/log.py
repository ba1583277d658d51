"""Which faults have happened, so that a test, or whoever looks at a simulated bench, can tell."""

from __future__ import annotations

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
