"""The runner's end of the guard: started with the run, armed before anything moves, sent a beat at every look.

A guard that dies, or no longer answers, is replaced without a stop: a campaign of days should not end because of it,
and while the new one starts the runner itself still watches the bench. Where that does not help either, the run ends.
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

from benchctl.bench import Bench, InstrumentEntry
from benchctl.campaign.guard.orders import BEAT, DONE, Orders, Reached
from benchctl.campaign.reserved import lock_files
from benchctl.campaign.rest import rest_within_s
from benchctl.own_process import own_process
from benchctl_instruments.errors import BenchError, SafetyError, reason

ANSWER_S = 30.0
"""How long a guard may take to answer, wall time: its start takes a quarter of a second where nothing else runs."""

BEAT_EVERY_S = 0.5
"""Wall time between two beats; a bench may be looked at much more often."""


class GuardChild:
    """One guard's process, its two pipes, and a thread that hears its answers. Not tried on Windows.

    A beat that is not answered yet is not followed by another one: so no pipe is ever full, and no write waits.
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
        """Send a beat, unless one was sent just before or is not answered yet."""
        now_s = time.monotonic()
        waits = self._said > self._heard
        if at_once or (not waits and now_s - self._said_at_s >= BEAT_EVERY_S):
            self._unanswered_since_s = self._unanswered_since_s if waits else now_s
            self._said_at_s = now_s
            self._said += 1
            self.say(f"{BEAT} {patience_s:.3f}")

    def say(self, word: str) -> None:
        """Send a word; a broken pipe shows in `gone`."""
        with contextlib.suppress(OSError):
            self._stdin.write(f"{word}\n".encode())

    def answers(self) -> bool:
        """Wait for the answer to the first beat; whether it came in time."""
        return self._first_answer.wait(ANSWER_S) and self._heard > 0

    def gone(self) -> str:
        """Why it cannot be relied upon; empty where it can."""
        if self._ended:
            return f"ended (exit status {self._process.returncode})"
        if self._said > self._heard and time.monotonic() - self._unanswered_since_s > ANSWER_S:
            return f"has not answered for {ANSWER_S:g} s"
        return ""

    def end(self) -> None:
        """End the pipe to it."""
        self._stdin.close()

    def kill(self) -> None:
        """End it without a word, so that it does nothing."""
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
"""Guards that may die in one run: what kills them will kill the next one too."""

Event = Callable[..., None]


class Guard(Protocol):
    """Whoever brings the bench to rest where the runner no longer can.

    `lost` says why there is nobody any more, `promise` what happens should the runner fail to bring it to rest.
    """

    lost: str
    promise: str

    def arm(self, event: Event) -> None:
        """Make sure that it is there, before anything moves; `event` notes in the journal what happens to it."""

    def beat(self, more_s: float = 0.0) -> None:
        """All is well, and it will be for `more_s` of wall time longer than usual until the next beat. Never raises."""

    def done(self) -> None:
        """The bench is at rest, read back."""


class NoGuard:
    """For a simulated bench in the runner's own process: it ends with it."""

    lost = ""
    promise = ""

    def arm(self, event: Event) -> None:
        """No guard."""

    def beat(self, more_s: float = 0.0) -> None:
        """Nothing is sent."""

    def done(self) -> None:
        """Nothing to end."""


@contextmanager
def guarded(bench: Bench, journal: Path) -> Iterator[Guard]:
    """A guard that is starting; to be entered before the bench is opened, so that its links are closed when it acts."""
    if bench.simulated:
        yield NoGuard()
        return
    guard = GuardProcess(_orders(bench, journal), bench.safe.hang_s)
    try:
        yield guard
    finally:
        guard.leave()


class GuardProcess:
    """A guard in a process of its own; see `Guard`. Not tried on Windows."""

    def __init__(self, orders: Orders, hang_s: float) -> None:
        self.lost = ""
        self.promise = f"; a guard process goes on trying, see {orders.journal}"
        self._orders, self._hang_s = orders, hang_s
        self._event: Event = lambda kind, **data: None
        self._replaced = 0
        self._child: GuardChild | None = GuardChild(orders)  # None: told that all is done, or lost

    def arm(self, event: Event) -> None:
        """Make sure that it is there; `SafetyError` where it does not answer."""
        self._event = event
        self.beat()
        child = self._child
        if child is None or not child.answers():
            why = self.lost or f"the guard process {child.gone() if child else ''}"
            raise SafetyError(f"{why}; without a guard nothing is moved; run again")
        self._note(f"process {child.pid} guards the run")

    def beat(self, more_s: float = 0.0) -> None:
        """All is well; starts another guard where this one is gone."""
        if self._child is None:
            return
        if why := self._child.gone():
            self._replace(self._child, why)
        else:
            self._child.beat(self._hang_s + more_s, at_once=more_s > 0)

    def done(self) -> None:
        """The bench is at rest: the guard may go."""
        if self._child is not None:
            self._child.say(DONE)
            self.leave()

    def leave(self) -> None:
        """End of the run; a guard that was armed and not told `done` acts now."""
        if self._child is not None:
            self._child.end()
            self._child = None

    def _replace(self, child: GuardChild, why: str) -> None:
        child.kill()  # it may only be stuck
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

    def _note(self, says: str) -> None:
        with contextlib.suppress(BenchError):  # a full disk ends the run, and not from within a beat
            self._event("guard", says=says)


def _orders(bench: Bench, journal: Path) -> Orders:
    return Orders(
        runner=os.getpid(),
        journal=journal.absolute(),
        time_factor=bench.time_factor,
        rest_within_s=rest_within_s(bench.limits.rate_dps, bench.limits.acceleration_dps2),
        safe_c=bench.safe.chamber_c,
        rate_table=_reached(bench.rate_table),
        chamber=_reached(bench.chamber, bench.chamber_profile),
    )


def _reached(entry: InstrumentEntry, profile: str = "") -> Reached:
    address = entry.address or ""
    return Reached(
        model=entry.model,
        address=address,
        options=entry.options,
        locks=[str(path) for path in lock_files(address)],
        profile=profile,
    )
