"""The guard listens: whether the runner is done, has ended, or hangs."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from enum import Enum
from io import RawIOBase

from benchctl.campaign.guard.orders import DONE

SLICE_S = 0.25
"""Silence is counted in slices: time in which the whole machine stood still is nobody's silence."""


class Ending(Enum):
    """How the watch ended."""

    UNARMED = "the runner ended before anything moved"
    DONE = "the runner brought the bench to rest"
    ENDED = "the runner ended without saying that the bench is at rest"
    HANGS = "the runner hangs"


class Lines:
    """The lines of a pipe, each within a time; a thread of its own reads, since not every system can wait on a pipe."""

    def __init__(self, pipe: RawIOBase) -> None:
        self._pipe = pipe
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, name="pipe from the runner", daemon=True).start()

    def next(self, timeout_s: float | None) -> str | None:
        """The next line; "" at the end of the pipe, None where none comes within `timeout_s` of wall time."""
        try:
            return self._lines.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def end(self, timeout_s: float) -> bool:
        """Whether the pipe ends within `timeout_s` of wall time."""
        until_s = time.monotonic() + timeout_s
        while (left_s := until_s - time.monotonic()) > 0:
            if self.next(left_s) == "":
                return True
        return False

    def _read(self) -> None:
        with self._pipe:
            while line := self._pipe.readline():
                self._lines.put(line.decode("utf-8"))
        self._lines.put("")


def watch(lines: Lines, answer: Callable[[], None]) -> Ending:
    """Listen until the guard must act or may go; `answer` is called for each beat."""
    allowed_s: float | None = None
    silent_s = 0.0
    while True:
        began_s = time.monotonic()
        line = lines.next(SLICE_S)
        if line is None:
            silent_s += min(time.monotonic() - began_s, 2 * SLICE_S)
            if allowed_s is not None and silent_s > allowed_s:
                return Ending.HANGS
            continue
        if not line:
            return Ending.UNARMED if allowed_s is None else Ending.ENDED
        if line.strip() == DONE:
            return Ending.DONE
        allowed_s, silent_s = float(line.split()[1]), 0.0
        answer()
