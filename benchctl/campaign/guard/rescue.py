"""The guard's action: take over the links, stop the table, set the chamber's safe set point, and read both back.

Each instrument has a thread and retries, so that a dead instrument, or one whose driver hangs, does not delay the other
one. A failed action is repeated every half second for ten minutes: by then, a controller that lost power, or a network
that was down, is back; later, the bench may be in use by another run. The result is written to the campaign's journal,
synced to the disk at once, to stderr, and as a message to the recipients of `[notify]`.

The guard cannot stop a manual table: it only alarms, on stderr and by a message, before anything else.
"""

from __future__ import annotations

import contextlib
import os
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchctl.atomic import disk_errors
from benchctl.campaign.guard.orders import Orders, Reached
from benchctl.campaign.rest import send_home, stop_table
from benchctl.locks import held, is_held
from benchctl.notifications import Recipient
from benchctl.recordings.journal import append_event, sync_journal
from benchctl_instruments.catalog import Kind, driver
from benchctl_instruments.errors import BenchError, UsageError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.rate_tables.manual import ONLY_THE_OPERATOR
from benchctl_instruments.simulated.clock import ScaledClock


def note(journal: Path, **data: object) -> None:
    """Append an event of kind "guard"; raises `UsageError` if the disk refuses.

    A last line that the dead runner left incomplete is ended first, so that it does not damage this one.
    """
    with disk_errors(journal), journal.open("ab+") as file:
        if file.tell():
            file.seek(-1, os.SEEK_END)
            if file.read() != b"\n":
                file.write(b"\n")
    append_event(journal, "guard", data)
    sync_journal(journal)


GIVE_UP_S = 600.0
"""Wall time during which a failed action is repeated."""

RETRY_S = 0.5
GRACE_S = 60.0
"""Additional wall time for the last attempt."""

_Reports = queue.SimpleQueue[str | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rescued:
    """Final state of the bench: rate and set point as read back, or None; `problems` list what was not read back."""

    rate_dps: float | None
    chamber_setpoint_c: float | None
    problems: tuple[str, ...]


class _Task:
    """Brings one instrument to rest, in a separate thread.

    The first failure is put into the queue, and None at the end.
    """

    def __init__(self, name: str, act: Callable[[], float], give_up_s: float, reports: _Reports) -> None:
        self.read_back: float | None = None
        self._name, self._act, self._give_up_s, self._reports = name, act, give_up_s, reports
        self._failure = "no answer at all"
        threading.Thread(target=self._try, name=name, daemon=True).start()

    @property
    def problem(self) -> str:
        """The last failure; empty if the instrument was read back."""
        return f"{self._name}: {self._failure}" if self.read_back is None else ""

    def _try(self) -> None:
        until_s = time.monotonic() + self._give_up_s
        failed = False
        while self.read_back is None:
            try:
                self.read_back = self._act()
            except Exception as err:  # any error: to give up would leave the bench in motion
                self._failure = str(err) if isinstance(err, BenchError) else repr(err)
                if not failed:
                    self._reports.put(f"trying again: {self.problem}")
                failed = True
                if time.monotonic() > until_s:
                    break
                time.sleep(RETRY_S)
        self._reports.put(None)


def rescue(orders: Orders, report: Callable[[str], None], give_up_s: float = GIVE_UP_S) -> Rescued:
    """Bring the bench to rest, the table first; `report` receives the start and the first failures.

    A manual table is a problem that remains.

    `report` is called only once the links are being taken over, and from this thread: a hanging disk must not keep the
    table turning.
    """
    clock = ScaledClock(orders.time_factor)
    reports: _Reports = queue.SimpleQueue()
    table = None if orders.by_hand else _Task("rate_table", lambda: _stop(orders, clock), give_up_s, reports)
    chamber = _Task("chamber", lambda: _go_home(orders, clock, reports.put), give_up_s, reports)
    report("taking over")
    deadline_s = time.monotonic() + give_up_s + GRACE_S
    busy = 1 if table is None else 2
    while busy and (left_s := deadline_s - time.monotonic()) > 0:
        with contextlib.suppress(queue.Empty):
            word = reports.get(timeout=left_s)
            if word is None:
                busy -= 1
            else:
                report(word)
    return Rescued(
        rate_dps=None if table is None else table.read_back,
        chamber_setpoint_c=chamber.read_back,
        problems=tuple(filter(None, (ONLY_THE_OPERATOR if table is None else table.problem, chamber.problem))),
    )


def _stop(orders: Orders, clock: Clock) -> float:
    with _opened("rate_table", orders.rate_table, clock) as table:
        return stop_table(table, clock, orders.rest_within_s, lambda: None)


def _go_home(orders: Orders, clock: Clock, remark: Callable[[str], None]) -> float:
    with _opened("chamber", orders.chamber, clock) as chamber:
        return send_home(chamber, orders.safe_c, remark)


@contextlib.contextmanager
def _opened(kind: Kind, reached: Reached, clock: Clock) -> Iterator[Any]:
    """Open the instrument for the guard alone; an instrument that another run has taken is left to that run."""
    paths = [Path(path) for path in reached.locks]
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(held(paths, f"{kind} at {reached.address}", "a guard that brings it to rest"))
        except UsageError:
            if any(is_held(path) for path in paths):
                raise  # else the folder of the locks is gone: this must not keep a table turning
        make = driver(kind, reached.model, reached.profile)
        yield stack.enter_context(make(reached.address, clock=clock, **reached.options))


def act(orders: Orders, why: str) -> bool:
    """Bring the bench to rest; `why` is the reason, in words. Return whether everything was read back."""
    unwritten = ""

    def report(message: str, **data: object) -> None:
        nonlocal unwritten
        try:
            note(orders.journal, says=f"{why}; {message}", **data)
        except BenchError as err:
            unwritten = f" (not in the journal: {err})"

    if orders.by_hand:
        _alarm(orders, f"{why}; {ONLY_THE_OPERATOR}: stop it NOW")
    rescued = rescue(orders, report)
    report(words(rescued), reason=why, **asdict(rescued))
    with contextlib.suppress(OSError):  # only at the end, because a terminal may be blocked or gone
        os.write(2, f"benchctl guard: {why}; {words(rescued)}{unwritten}\n".encode())
    _notify(orders, f"{why}; {words(rescued)}")
    return not rescued.problems


def _alarm(orders: Orders, message: str) -> None:
    """Write to stderr and send a message, in a separate thread: a blocked terminal must not delay the chamber."""

    def alarm() -> None:
        with contextlib.suppress(OSError):
            os.write(2, f"benchctl guard: {message}\n".encode())
        _notify(orders, message)

    threading.Thread(target=alarm, name="alarm", daemon=True).start()


def _notify(orders: Orders, message: str) -> None:
    """Send a message; at the end, or in a separate thread, because a mail server may be slow."""
    campaign = orders.journal.parent
    for url in orders.notify:
        try:
            Recipient(url).send(f"guard: {campaign.name}", f"{message}\n{campaign}")
        except BenchError as err:
            with contextlib.suppress(OSError):
                os.write(2, f"benchctl guard: {err}\n".encode())
            with contextlib.suppress(BenchError):
                note(orders.journal, says=str(err))


def words(rescued: Rescued) -> str:
    """Return the result in one line."""
    rest = f"table at rest ({rescued.rate_dps:+.3f} deg/s)" if rescued.rate_dps is not None else ""
    home = f"chamber set to {rescued.chamber_setpoint_c:g} °C" if rescued.chamber_setpoint_c is not None else ""
    confirmed = f"{' and '.join(filter(None, (rest, home)))}, read back" if rest or home else ""
    failed = f"NOT CONFIRMED: {'; '.join(rescued.problems)}; go and look" if rescued.problems else ""
    return "; ".join(filter(None, (confirmed, failed)))
