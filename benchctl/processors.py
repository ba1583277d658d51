"""Set the processors of threads, and of processes started meanwhile.

A simulated bench runs on one processor, since both ends of its wires run in one interpreter. Its threads take turns,
hundreds of thousands of times in a campaign of 20 set points. A switch to a thread on another processor takes three
times as long as on the same one, and the threads can do almost nothing in parallel.

Of several processes with simulated benches, each reserves one processor; if none is free, the system chooses.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

_before: dict[int, set[int]] = {}
"""For each processor to which threads are bound: the processors that they could use before."""


def several() -> list[int]:
    """Return the processors to which this thread can be bound; none if it has only one or binding is not possible."""
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
    """Bind this thread, and all threads that it starts in the block, to one of the processors of `several`.

    Threads started in the block must end with it.
    """
    if sys.platform != "linux":
        raise OSError("threads can be kept on a processor on Linux only")
    thread = threading.get_native_id()
    _before[processor] = os.sched_getaffinity(thread)
    os.sched_setaffinity(thread, {processor})
    try:
        yield
    finally:
        allowed = _before.pop(processor)
        with suppress(ProcessLookupError):  # the thread has ended
            os.sched_setaffinity(thread, allowed)


def set_free(pid: int) -> None:
    """Allow a process started inside `only_on` to use the processors that this process could use before."""
    if sys.platform != "linux" or not _before:
        return
    here = os.sched_getaffinity(0)
    for processor, allowed in list(_before.items()):
        if here == {processor}:
            with suppress(ProcessLookupError):  # the process has ended
                os.sched_setaffinity(pid, allowed)


_NAME = "\0benchctl-processor-"
"""Prefix of abstract socket names. Linux binds such a name to one socket at a time, and frees it with the process."""


@contextmanager
def on_one_processor() -> Iterator[None]:
    """Bind this thread and those that it starts to one processor during the block, if one is free."""
    with ExitStack() as stack:
        for processor in reversed(several()):  # the first one has the most other work
            held = _taken(processor)
            if held is not None:
                stack.enter_context(held)
                stack.enter_context(only_on(processor))
                break
        yield


def _taken(processor: int) -> socket.socket | None:
    """Return a socket that reserves the processor until it is closed; None if another process has reserved it."""
    held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        held.bind(f"{_NAME}{processor}")
    except OSError:
        held.close()
        return None
    return held
