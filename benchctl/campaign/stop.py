"""Stop requests: a signal (Ctrl-C, the system) or a file in the campaign's folder (the live page).

An exception raised in a signal handler could interrupt an exchange with an instrument, and the next answer on that link
would belong to the previous question. So the handler only sets a flag, which the runner checks between two looks.

A process that sends no signals writes a file:

```
{"who": "operator", "asked_utc": "2026-11-20T18:00:00+00:00"}
```

This requires only the folder, and the run looks for the file between two looks at its instruments. The file counts only
for the run that holds the campaign's lock, and only if it was written after the lock was taken: a file from an earlier
run stops nothing. It is removed once the campaign is closed, and no manifest lists it.
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
"""Wall time between two checks of other sources than the signals: `heed` is called thousands of times."""


class StoppedError(BenchError):
    """The run was stopped from outside; not a failure of the bench."""


class StopRequest:
    """Whether a stop of the run was requested, and by what."""

    def __init__(self) -> None:
        self.reason = ""
        self._look_for_request: Callable[[], str] | None = None
        self._look_s = 0.0

    def ask(self, reason: str) -> None:
        """Request a stop; the first reason is kept."""
        self.reason = self.reason or reason

    def watch(self, request: Callable[[], str]) -> None:
        """Let `heed` also call this function, at most five times a second; it returns who requests a stop, or ""."""
        self._look_for_request = request

    def heed(self) -> None:
        """Raise `StoppedError` if a stop was requested."""
        if self._look_for_request is not None and time.monotonic() >= self._look_s:
            self._look_s = time.monotonic() + _LOOK_EVERY_S
            self.ask(self._look_for_request())
        if self.reason:
            raise StoppedError(f"stopped by {self.reason}")


@contextmanager
def stop_on_signals(*, deaf_after: bool = True) -> Iterator[StopRequest]:
    """Yield a `StopRequest` that is set by Ctrl-C, SIGTERM, SIGHUP and Windows' Ctrl-Break while the block runs.

    One signal is enough: after the first, further signals have no effect, so that coming to rest is not cut short. With
    `deaf_after` they are also ignored after the block, where the program should end. A SIGHUP that is ignored, as under
    nohup, stays ignored. Outside the main thread, where Python receives no signals, the request can only be set by
    `ask`.
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
    """No process writes the campaign, so there is no run to stop."""


def ask_by_file(folder: Path, who: str) -> None:
    """Request a stop of the run that writes a campaign's folder; `who` names the requester, in a word or two.

    Raises
    ------
    NotRunningError
        No run holds the campaign's lock, or it ended meanwhile.
    UsageError
        The folder is not writable.
    """
    require_run(folder)
    with whole_file(folder / STOP) as temporary:
        temporary.write_text(json.dumps({"who": who, "asked_utc": datetime.now(UTC).isoformat(timespec="seconds")}))
    try:
        require_run(folder)
    except NotRunningError:
        forget_stop(folder)
        raise


def is_asked(folder: Path) -> bool:
    """Whether a campaign's folder contains a stop request that its run has not obeyed yet."""
    return (folder / STOP).exists()


def heed_file(stop: StopRequest, folder: Path) -> None:
    """Let a run's `stop` also obey the request in its campaign's folder, which need not exist yet."""
    path = folder / STOP

    def request() -> str:
        try:
            path.stat()
        except OSError:
            return ""
        return f"the live page ({_who(path)})"

    stop.watch(request)


def forget_stop(folder: Path) -> None:
    """Remove a stop request; the caller has the campaign's lock, or has just closed the campaign."""
    with suppress(OSError):
        (folder / STOP).unlink()


def forget_stale_stop(folder: Path) -> None:
    """Remove a stop request that an earlier run has left; one that came after the lock was taken stays.

    The caller has the campaign's lock.
    """
    with suppress(OSError):
        if (folder / STOP).stat().st_mtime_ns < (folder / LOCK).with_suffix(".json").stat().st_mtime_ns:
            forget_stop(folder)


def require_run(folder: Path) -> None:
    """Raise `NotRunningError` if no run holds the campaign's lock."""
    if not is_held(folder / LOCK):
        raise NotRunningError(f"campaign {folder.name}: it is not running; there is nothing to stop")


def _who(path: Path) -> str:
    """Return the requester that the file states; a stop is obeyed whatever the file contains."""
    try:
        who = read_json(path, "stop request")["who"]
    except (UsageError, KeyError, TypeError):
        return "somebody"
    return cut("".join(letter for letter in str(who) if letter.isprintable()), _LONGEST_WHO) or "somebody"
