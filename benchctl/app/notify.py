"""Send messages about a run to the recipients of `[notify]`: its end, waits, certificates; and test messages."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchctl.bench import Bench
from benchctl.campaign.runner import Outcome
from benchctl.campaign.stop import StoppedError
from benchctl.notifications import Event, Recipient, masked, urls_of
from benchctl.plan import Plan
from benchctl_instruments.errors import BenchError, UsageError

PATIENCE_S = 30.0
"""Wall time that the last messages of a run may take, after the bench is at rest and the recording is closed."""


class Messenger:
    """Sends messages about one run from a thread, so that no mail server delays the run.

    `subject` is part of each title, `campaign` the folder that each message names.
    """

    def __init__(self, recipients: list[Recipient], on: tuple[Event, ...], subject: str, campaign: Path) -> None:
        self.failures: list[str] = []
        self._recipients, self._on, self._subject, self._campaign = recipients, on, subject, campaign
        self._waiting: queue.SimpleQueue[tuple[str, str] | None] = queue.SimpleQueue()
        self._failed: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="messages", daemon=True)
        if recipients:
            self._thread.start()

    def send(self, event: Event, message: str) -> None:
        """Send a message, if the event is one to report; return at once."""
        if self._recipients and event in self._on:
            self._waiting.put((f"{event}: {self._subject}", f"{message}\n{self._campaign.absolute()}"))

    def hear(self, kind: str, data: Mapping[str, object]) -> list[str]:
        """Report an event of a running campaign; return the messages that were not delivered since the last call."""
        match kind:
            case "certificate":
                self.send("certificate", str(data["says"]))
            case "hold" if data["on"]:
                self.send("hold", f"on hold, the table at rest: {data['says']}")
            case "waiting":
                self.send("hold", f"waiting for {data['by']}: {data['says']}")
        return self._new_failures()

    def end(self, outcome: Outcome) -> list[str]:
        """Report the end of a campaign and wait for all messages; return those that were not delivered, as `hear`."""
        event: Event = "done"
        if outcome.error is not None:
            event = "stopped" if isinstance(outcome.error, StoppedError) else "fault"
        steps = f"{outcome.status}: {outcome.whole} of {outcome.planned} steps complete, {outcome.samples:,} samples"
        self.send(event, f"{steps}, {outcome.bench_time_s / 3600:.1f} h of bench time\n{outcome.error or ''}".strip())
        return self.close()

    def close(self) -> list[str]:
        """Wait for all messages, at most `PATIENCE_S`; return those that were not delivered since the last call."""
        if self._thread.is_alive() and not self._closed:
            self._closed = True
            self._waiting.put(None)
            self._thread.join(PATIENCE_S)
            if self._thread.is_alive():
                self._failed.put(f"the last messages were not delivered within {PATIENCE_S:g} s; look at the network")
        return self._new_failures()

    def _new_failures(self) -> list[str]:
        new = []
        while not self._failed.empty():
            new.append(self._failed.get())
        self.failures += new
        return new

    def _work(self) -> None:
        while (message := self._waiting.get()) is not None:
            for recipient in self._recipients:
                try:
                    recipient.send(*message)
                except BenchError as err:
                    self._failed.put(str(err))


@contextmanager
def messages_about(plan: Plan, bench: Bench, campaign: Path, warn: Callable[[str], None]) -> Iterator[Messenger]:
    """Yield the messenger of a run; an exception that ends the run is reported, too.

    `warn` receives, at the beginning, the recipients that cannot be used, and, at the end, each message that was not
    delivered. Nothing here ends or delays the run.
    """
    recipients = []
    for url in urls_of(bench.notify):
        try:
            recipients.append(Recipient(url))
        except UsageError as err:
            warn(f"{err}; no messages go there")
    subject = f"{plan.procedure}, unit {bench.unit.serial}, {bench.name}"
    messenger = Messenger(recipients, bench.notify.on if bench.notify else (), subject, campaign)
    try:
        yield messenger
    except Exception as err:
        messenger.send("fault", str(err) if isinstance(err, BenchError) else f"a fault of the program: {err!r}")
        raise
    finally:
        messenger.close()
        for message in messenger.failures:
            warn(message)


def send_result(plan: Plan, bench: Bench, campaign: Path, message: str, warn: Callable[[str], None]) -> None:
    """Send the result of a campaign that has ended; `warn` is as in `messages_about`."""
    with messages_about(plan, bench, campaign, warn) as messenger:
        messenger.send("result", message)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """A test message: the masked URL, and what prevents its delivery; `known` is false if the URL cannot be used."""

    url: str
    known: bool
    problem: str


def try_recipients(bench: Bench, *, send: bool) -> Iterator[Tried]:
    """Try each recipient of `[notify]`, one after the other, by a test message, if `send`.

    Raises
    ------
    UsageError
        If the bench has no `[notify]`.
    """
    if bench.notify is None:
        raise UsageError(f"bench {bench.name}: there is no [notify] with urls in its file; add it to get messages")
    for url in urls_of(bench.notify):
        shown = masked(url)
        try:
            recipient = Recipient(url)
            if send:
                recipient.send(f"test: {bench.name}", "a test message of benchctl notify: messages arrive here")
        except UsageError as err:
            yield Tried(url=shown, known=False, problem=str(err))
        except BenchError as err:
            yield Tried(url=shown, known=True, problem=str(err))
        else:
            yield Tried(url=shown, known=True, problem="")
