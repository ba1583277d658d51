"""A simulated bench on one processor: it plays both ends of its wires in one interpreter.

Its threads only take turns, hundreds of thousands of times in a campaign of 20 set points. To hand over to a thread on
another processor takes three times as long as on the same, and there is next to nothing that both could do at once.

Processes that play benches side by side each take a processor of their own; where none is left, the system chooses.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from benchctl.processors import only_on, several

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
    """What says that the processor is this process', until it is closed; None where it is another's."""
    held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        held.bind(f"{_NAME}{processor}")
    except OSError:
        held.close()
        return None
    return held
