"""A wish to stop, from Ctrl-C or the system: noted by the signal's handler, heeded by the runner between two looks.

An exception out of a signal handler could tear an exchange with an instrument in two, and the next answer on that link
would be that of the question before. So the handler only takes a note.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from instruments.errors import BenchError


class StoppedError(BenchError):
    """The run was stopped from outside; not a failure of the bench."""


class StopRequest:
    """Whether, and by what, the run was asked to stop."""

    def __init__(self) -> None:
        self.reason = ""

    def ask(self, reason: str) -> None:
        """Ask for a stop; the first reason stays."""
        self.reason = self.reason or reason

    def heed(self) -> None:
        """Raise `StoppedError` where a stop was asked for."""
        if self.reason:
            raise StoppedError(f"stopped by {self.reason}")


@contextmanager
def stop_on_signals() -> Iterator[StopRequest]:
    """A `StopRequest` that Ctrl-C, SIGTERM, SIGHUP and Windows' Ctrl-Break set while the block runs.

    Whoever has asked once need not ask again: from then on these signals change nothing any more, so that neither
    coming to rest nor the end of the program is cut short. A SIGHUP that is ignored, as under nohup, stays ignored.
    Outside the main thread, where Python takes no signals, the request can only be set by hand.
    """
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return

    def note(number: int, _frame: FrameType | None) -> None:
        request.ask("Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name)

    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    if getattr(signal, "SIGHUP", None) in numbers and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        numbers.remove(signal.SIGHUP)
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if request.reason else handler)
