"""How slow this machine is at the moment: limits on time are for hangs, not for what others do to a shared machine."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

_ITEMS = 200_000
_QUIET_S = 0.05
"""Processor time of the piece of work on a quiet core of an Intel Xeon (Python 3.11)."""


def slowness() -> float:
    """Processor time of a fixed piece of work that goes through memory, over what it takes on a quiet machine; >= 1."""
    begun = time.process_time()
    words = [str(number) for number in range(_ITEMS)]
    words.sort()
    "".join(words).encode().count(b"7")
    return max(1.0, (time.process_time() - begun) / _QUIET_S)


class Lateness:
    """How late this machine lets a sleeping thread run: milliseconds on a quiet machine, much more on a busy one."""

    worst_s = 0.0


@contextmanager
def lateness() -> Iterator[Lateness]:
    """Measure the lateness of a sleeping thread while the block runs."""
    found, ended = Lateness(), threading.Event()

    def sleep_and_look() -> None:
        while not ended.is_set():
            begun_s = time.monotonic()
            time.sleep(0.01)
            found.worst_s = max(found.worst_s, time.monotonic() - begun_s - 0.01)

    thread = threading.Thread(target=sleep_and_look)
    thread.start()
    try:
        yield found
    finally:
        ended.set()
        thread.join()
