"""Waiting for what another process or thread does, as long as a test is willing to."""

from __future__ import annotations

import time
from collections.abc import Callable


def wait_until(is_so: Callable[[], bool], within_s: float, otherwise: str = "") -> None:
    """Look until something is so; the test fails, saying `otherwise`, where it is not in time."""
    end_s = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < end_s, otherwise
        time.sleep(0.01)
