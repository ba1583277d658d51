"""Which processors threads work on, and those that a process started meanwhile may use.

A simulated bench is played on one processor, for it plays both ends of its wires in one interpreter.
Its threads only take turns, hundreds of thousands of times in a campaign of 20 set points. To hand over to a thread on
another processor takes three times as long as on the same, and there is next to nothing that both could do at once.

Processes that play benches side by side each take a processor of their own; where none is left, the system chooses.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

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


_NAME = "\0benchctl-processor-"
"""Linux gives names that begin so to one socket at a time, and takes them back when its process ends."""


@contextmanager
def on_one_processor() -> Iterator[None]:
    """Keep this thread and those that it starts on one processor while the block runs, if there is one to be had."""
    with ExitStack() as stack:
        for processor in reversed(several()):  # the first has the most to do beside
            held = _taken(processor)
            if held is not None:
                stack.enter_context(held)
                stack.enter_context(only_on(processor))
                break
        yield


def _taken(processor: int) -> socket.socket | None:
    """A socket that reserves the processor for this process until it is closed; None where another process has it."""
    held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        held.bind(f"{_NAME}{processor}")
    except OSError:
        held.close()
        return None
    return held
