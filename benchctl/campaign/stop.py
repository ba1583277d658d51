"""A request to stop: a signal (Ctrl-C, the system) or a file in the campaign's folder (the live page).

An exception out of a signal handler could tear an exchange with an instrument in two, and the next answer on that link
would be that of the question before. So the handler only takes a note, which the runner heeds between two looks.

A process that sends no signals leaves a file:

```
{"who": "operator", "asked_utc": "2026-11-20T18:00:00+00:00"}
```

It needs no more than the folder, and the run looks for the file between two looks at its instruments. The file counts
only for the run that holds the campaign's lock, and only where it was written since that took it: what an earlier run
left behind stops nobody. It is removed once the campaign is closed, and no manifest names it.
"""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType

from benchctl.atomic import whole_file
from benchctl.documents import read_json
from benchctl.limits import cut
from benchctl.locks import is_held
from benchctl.recordings.schema import LOCK, STOP
from benchctl_instruments.errors import BenchError, UsageError

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


_LONGEST_WHO = 60


class NotRunningError(UsageError):
    """No process writes the campaign: there is no run to stop."""


def ask_by_file(folder: Path, who: str) -> None:
    """Ask the run that writes a campaign's folder to stop; `who` asks, in a word or two.

    Raises
    ------
    NotRunningError
        Where no run holds the campaign's lock, or it ended meanwhile.
    UsageError
        Where the folder may not be written to.
    """
    _require_run(folder)
    with whole_file(folder / STOP) as temporary:
        temporary.write_text(json.dumps({"who": who, "asked_utc": datetime.now(UTC).isoformat(timespec="seconds")}))
    try:
        _require_run(folder)
    except NotRunningError:
        forget_stop(folder)
        raise


def is_asked(folder: Path) -> bool:
    """Whether a wish to stop lies in a campaign's folder that its run has not heeded yet."""
    return (folder / STOP).exists()


def heed_file(stop: StopRequest, folder: Path) -> None:
    """Let a run's `stop` also heed what is asked in its campaign's folder, which need not be there yet."""
    path = folder / STOP

    def asked() -> str:
        try:
            path.stat()
        except OSError:
            return ""
        return f"the live page ({_who(path)})"

    stop.watch(asked)


def forget_stop(folder: Path) -> None:
    """Remove a wish to stop; who calls this has the campaign's lock, or has just closed the campaign."""
    with suppress(OSError):
        (folder / STOP).unlink()


def forget_stale_stop(folder: Path) -> None:
    """Remove a wish to stop that an earlier run has left; one that came since the lock was taken stays.

    Who calls this has the campaign's lock.
    """
    with suppress(OSError):
        if (folder / STOP).stat().st_mtime_ns < (folder / LOCK).with_suffix(".json").stat().st_mtime_ns:
            forget_stop(folder)


def _require_run(folder: Path) -> None:
    if not is_held(folder / LOCK):
        raise NotRunningError(f"campaign {folder.name}: nobody runs it any more; there is nothing to stop")


def _who(path: Path) -> str:
    """Who asks, as far as the file states it: a stop is heeded whatever is in it."""
    try:
        who = read_json(path, "stop request")["who"]
    except (UsageError, KeyError, TypeError):
        return "somebody"
    return cut("".join(letter for letter in str(who) if letter.isprintable()), _LONGEST_WHO) or "somebody"
