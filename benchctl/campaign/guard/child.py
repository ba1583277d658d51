"""One guard's process, as the runner sees it: told that all is well, and heard to answer."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from typing import IO, cast

from benchctl.campaign.guard.orders import BEAT, Orders
from benchctl.own_process import own_process

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
        self._stdin, self._stdout = cast(IO[bytes], self._process.stdin), cast(IO[bytes], self._process.stdout)
        self.pid = self._process.pid
        self._said = self._heard = 0
        self._said_at_s = -math.inf
        self._unanswered_since_s = math.inf
        self._first_answer, self._ended = threading.Event(), False
        self.say(orders.as_line())
        threading.Thread(target=self._listen, name=f"guard {self.pid}", daemon=True).start()

    def beat(self, patience_s: float, *, at_once: bool) -> None:
        """Say that all is well, unless that was said just before or waits to be heard."""
        now_s = time.monotonic()
        waits = self._said > self._heard
        if at_once or (not waits and now_s - self._said_at_s >= BEAT_EVERY_S):
            self._unanswered_since_s = self._unanswered_since_s if waits else now_s
            self._said_at_s = now_s
            self._said += 1
            self.say(f"{BEAT} {patience_s:.3f}")

    def say(self, word: str) -> None:
        """Say a word; that nobody hears it any more shows in `gone`."""
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
