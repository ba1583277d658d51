"""Which of the processors threads work on, and those that a process started meanwhile finds."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_before: dict[int, set[int]] = {}
"""By a processor that threads are kept on: those that they could work on before."""


def several() -> list[int]:
    """The processors that this thread may choose from; none where it has but one, or the system does not let it."""
    if sys.platform != "linux":
        return []
    allowed = sorted(os.sched_getaffinity(0))
    try:
        os.sched_setaffinity(0, allowed)
    except OSError:
        return []
    return allowed if len(allowed) > 1 else []


@contextmanager
def only_on(processor: int) -> Iterator[None]:
    """Keep this thread on one of the `several`, and those that it starts meanwhile, which are to end with the block."""
    if sys.platform != "linux":
        raise OSError("threads can be kept on a processor on Linux only")
    thread = threading.get_native_id()
    _before[processor] = os.sched_getaffinity(thread)
    os.sched_setaffinity(thread, {processor})
    try:
        yield
    finally:
        allowed = _before.pop(processor)
        with suppress(ProcessLookupError):  # the thread is over
            os.sched_setaffinity(thread, allowed)


def set_free(pid: int) -> None:
    """Let a process that was started meanwhile work wherever this one could before."""
    if sys.platform != "linux" or not _before:
        return
    here = os.sched_getaffinity(0)
    for processor, allowed in list(_before.items()):
        if here == {processor}:
            with suppress(ProcessLookupError):  # it is over already
                os.sched_setaffinity(pid, allowed)
