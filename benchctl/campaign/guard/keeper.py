"""The runner's end of the guard: started with the run, armed before anything moves, sent a beat at every look.

A guard that dies, or no longer answers, is replaced without a stop, because a campaign of days should not end for this
reason; while the new one starts, the runner itself still watches the bench. If this does not help either, the run ends.
"""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Protocol, cast

from benchctl.bench import Bench
from benchctl.bench_instruments import InstrumentEntry
from benchctl.campaign.guard.orders import BEAT, DONE, Orders, Reached
from benchctl.campaign.reserved import lock_files
from benchctl.campaign.rest import rest_within_s
from benchctl.notifications import urls_of
from benchctl.own_process import own_process
from benchctl_instruments.errors import BenchError, SafetyError, reason

ANSWER_S = 30.0
"""Wall time that a guard may take to answer; its start takes a quarter of a second on an idle machine."""

BEAT_EVERY_S = 0.5
"""Minimum wall time between two beats; the bench may be looked at much more often."""


class GuardChild:
    """One guard process, its two pipes, and a thread that reads its answers. Not tested on Windows.

    While a beat is not answered, no other one is sent, so a pipe is never full and no write waits.
    """

    def __init__(self, orders: Orders) -> None:
        self._process = own_process("benchctl.campaign.guard")
        self._stdin, self._stdout = cast("IO[bytes]", self._process.stdin), cast("IO[bytes]", self._process.stdout)
        self.pid = self._process.pid
        self._said = self._heard = 0
        self._said_at_s = -math.inf
        self._unanswered_since_s = math.inf
        self._first_answer, self._ended = threading.Event(), False
        self.say(orders.as_line())
        threading.Thread(target=self._listen, name=f"guard {self.pid}", daemon=True).start()

    def beat(self, patience_s: float, *, at_once: bool) -> None:
        """Send a beat, unless one was sent just before or is not answered yet; `at_once` sends it in any case."""
        now_s = time.monotonic()
        waits = self._said > self._heard
        if at_once or (not waits and now_s - self._said_at_s >= BEAT_EVERY_S):
            self._unanswered_since_s = self._unanswered_since_s if waits else now_s
            self._said_at_s = now_s
            self._said += 1
            self.say(f"{BEAT} {patience_s:.3f}")

    def say(self, word: str) -> None:
        """Send a line; a broken pipe shows in `gone`."""
        with contextlib.suppress(OSError):
            self._stdin.write(f"{word}\n".encode())

    def answers(self) -> bool:
        """Wait for the answer to the first beat; return whether it came in time."""
        return self._first_answer.wait(ANSWER_S) and self._heard > 0

    def gone(self) -> str:
        """Return why the guard cannot be relied upon; empty if it can."""
        if self._ended:
            return f"ended (exit status {self._process.returncode})"
        if self._said > self._heard and time.monotonic() - self._unanswered_since_s > ANSWER_S:
            return f"has not answered for {ANSWER_S:g} s"
        return ""

    def end(self) -> None:
        """Close the pipe to the guard."""
        self._stdin.close()

    def kill(self) -> None:
        """Kill the guard without a message, so that it does not act."""
        self._process.kill()
        self._stdin.close()

    def _listen(self) -> None:
        with self._stdout:
            while self._stdout.readline():
                self._heard += 1
                self._first_answer.set()
        self._process.wait()
        self._ended = True
        self._first_answer.set()


MOST_REPLACED = 3
"""Number of guards that may die in one run: what kills them will also kill the next one."""

Event = Callable[..., None]


class Guard(Protocol):
    """Brings the bench to rest if the runner no longer can.

    `lost` states why there is no guard any more, `promise` what happens if the runner fails to bring the bench to rest.
    """

    lost: str
    promise: str

    def arm(self, event: Event) -> None:
        """Make sure that the guard runs, before anything moves; `event` records in the journal what happens to it."""

    def beat(self, more_s: float = 0.0) -> None:
        """Report that all is well; the next beat may come `more_s` of wall time later than usual. Never raises."""

    def done(self) -> None:
        """Report that the bench is at rest and was read back."""


class NoGuard:
    """No guard, for a simulated bench in the runner's own process, which ends with the runner."""

    lost = ""
    promise = ""

    def arm(self, event: Event) -> None:
        """Do nothing."""

    def beat(self, more_s: float = 0.0) -> None:
        """Do nothing."""

    def done(self) -> None:
        """Do nothing."""


@contextmanager
def guarded(bench: Bench, journal: Path) -> Iterator[Guard]:
    """Start a guard; enter this before the bench is opened, so that the bench's links are closed when it acts."""
    if bench.simulated:
        yield NoGuard()
        return
    guard = GuardProcess(_orders(bench, journal), bench.safe.hang_s)
    try:
        yield guard
    finally:
        guard.leave()


class GuardProcess:
    """A guard in a separate process; see `Guard`. Not tested on Windows."""

    def __init__(self, orders: Orders, hang_s: float) -> None:
        self.lost = ""
        tries = "sends the chamber home, but cannot stop the table" if orders.by_hand else "goes on trying"
        self.promise = f"; a guard process {tries}, see {orders.journal}"
        self._orders, self._hang_s = orders, hang_s
        self._event: Event = lambda kind, **data: None
        self._replaced = 0
        self._child: GuardChild | None = GuardChild(orders)  # None: finished, or lost

    def arm(self, event: Event) -> None:
        """Make sure that the guard runs; raises `SafetyError` if it does not answer."""
        self._event = event
        self.beat()
        child = self._child
        if child is None or not child.answers():
            why = self.lost or f"the guard process {child.gone() if child else ''}"
            raise SafetyError(f"{why}; without a guard nothing is moved; run again")
        self._note(f"process {child.pid} guards the run")

    def beat(self, more_s: float = 0.0) -> None:
        """Report that all is well; start another guard if this one is gone."""
        if self._child is None:
            return
        if why := self._child.gone():
            self._replace(self._child, why)
        else:
            self._child.beat(self._hang_s + more_s, at_once=more_s > 0)

    def done(self) -> None:
        """Report that the bench is at rest, so that the guard ends."""
        if self._child is not None:
            self._child.say(DONE)
            self.leave()

    def leave(self) -> None:
        """End the run; a guard that was armed and has not received `done` acts now."""
        if self._child is not None:
            self._child.end()
            self._child = None

    def _replace(self, child: GuardChild, why: str) -> None:
        child.kill()  # it may only hang
        self._child = None
        self._replaced += 1
        if self._replaced > MOST_REPLACED:
            self._lose(f"{why}, {self._replaced} times in this run; find out what ends it")
            return
        try:
            self._child = GuardChild(self._orders)
        except OSError as err:
            self._lose(f"{why}, and no other one can be started: {reason(err)}")
            return
        self._note(f"process {child.pid} {why}; process {self._child.pid} takes its place")
        self._child.beat(self._hang_s, at_once=True)

    def _lose(self, why: str) -> None:
        self.lost, self.promise = f"the guard process {why}", ""
        self._note(self.lost)

    def _note(self, message: str) -> None:
        with contextlib.suppress(BenchError):  # a full disk ends the run, but not from within a beat
            self._event("guard", says=message)


def _orders(bench: Bench, journal: Path) -> Orders:
    return Orders(
        runner=os.getpid(),
        journal=journal.absolute(),
        time_factor=bench.time_factor,
        rest_within_s=rest_within_s(bench.limits.rate_dps, bench.limits.acceleration_dps2),
        safe_c=bench.safe.chamber_c,
        rate_table=_reached(bench.rate_table),
        chamber=_reached(bench.chamber, bench.chamber_profile),
        notify=urls_of(bench.notify) if bench.notify and "guard" in bench.notify.on else [],
    )


def _reached(entry: InstrumentEntry, profile: str = "") -> Reached:
    address = entry.address or ""
    return Reached(
        model=entry.model,
        address=address,
        options=entry.options,
        locks=[str(path) for path in lock_files(address)] if address else [],
        profile=profile,
    )
