"""How slow this machine is at the moment: limits on time are for hangs, not for what others do to a shared machine."""

from __future__ import annotations

import time

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
