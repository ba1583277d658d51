"""A wish to stop, from Ctrl-C or the system: noted by the signal's handler, heeded by the runner between two looks.

An exception out of a signal handler could tear an exchange with an instrument in two, and the next answer on that link
would be that of the question before. So the handler only takes a note.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from benchctl_instruments.errors import BenchError

_LOOK_EVERY_S = 0.2
"""Wall time between two looks at what may ask for a stop beside the signals: `heed` is called thousands of times."""


class StoppedError(BenchError):
    """The run was stopped from outside; not a failure of the bench."""


class StopRequest:
    """Whether, and by what, the run was asked to stop."""

    def __init__(self) -> None:
        self.reason = ""
        self._asked: Callable[[], str] | None = None
        self._look_s = 0.0

    def ask(self, reason: str) -> None:
        """Ask for a stop; the first reason stays."""
        self.reason = self.reason or reason

    def watch(self, asked: Callable[[], str]) -> None:
        """Let `heed` look there too, at most five times a second: `asked` says who wants a stop, or nothing."""
        self._asked = asked

    def heed(self) -> None:
        """Raise `StoppedError` where a stop was asked for."""
        if self._asked is not None and time.monotonic() >= self._look_s:
            self._look_s = time.monotonic() + _LOOK_EVERY_S
            self.ask(self._asked())
        if self.reason:
            raise StoppedError(f"stopped by {self.reason}")


@contextmanager
def stop_on_signals(*, deaf_after: bool = True) -> Iterator[StopRequest]:
    """A `StopRequest` that Ctrl-C, SIGTERM, SIGHUP and Windows' Ctrl-Break set while the block runs.

    Whoever has asked once need not ask again: from then on these signals change nothing any more, so that coming to
    rest is not cut short; with `deaf_after` nor is the end of the program, which then is to follow. A SIGHUP that is
    ignored, as under nohup, stays ignored. Outside the main thread, where Python takes no signals, the request can only
    be set by hand.
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
            signal.signal(number, signal.SIG_IGN if request.reason and deaf_after else handler)
