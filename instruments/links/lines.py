"""A dialogue of one line for one line over any link that carries bytes. The driver interprets the lines.

Error policy: a query without an answer is repeated once on a new connection, because a query changes nothing. A command
is repeated only if the caller permits it. After any failure the connection is closed and the line left quiet for
`QUIET_S`, so that a late answer is never taken for the answer to the next question.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.serial_port import ByteLink
from benchctl_instruments.links.tcp import LinkCutError
from benchctl_instruments.links.wirelog import note_recovered
from benchctl_instruments.protocols.lines import NOT_PRINTING, LineCutter, encode_line

QUIET_S = 0.1  # wall time
MAX_TEXT = 65536
"""Largest answer of several lines, in bytes."""

ADVICE = "check power, cable, speed and address, and that nobody else holds the link"


class NoAnswerError(LinkError):
    """The connection is open, but no complete answer arrived in time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Manners:
    """Communication settings of an instrument.

    `sent_end` is appended to each sent line, `answer_end` ends an answer (None: CR, LF or both). `timeout_s` is the
    timeout, in wall time, of a connection and of a complete answer; the line stays quiet for `pause_s` of bench time
    between two exchanges. If `commands_answered` is false, only queries are answered. `trimmed` are the bytes that are
    dropped before and after an answer, `advice` is what to do if none arrives.
    """

    sent_end: bytes = b"\r\n"
    answer_end: bytes | None = b"\n"
    encoding: str = "ascii"
    timeout_s: float = 1.0
    pause_s: float = 0.0
    commands_answered: bool = True
    trimmed: bytes = NOT_PRINTING
    advice: str = ADVICE


class LineDialogue:
    """A dialogue with one instrument; all exchanges are thread-safe.

    Parameters
    ----------
    name
        The name of the instrument in error messages.
    link
        The link; the dialogue opens and closes it.
    manners
        Communication settings of the instrument.
    clock
        The clock used for pauses.
    """

    def __init__(self, name: str, link: ByteLink, *, manners: Manners, clock: Clock) -> None:
        self.who = f"{name} at {link.address}"
        self._link = link
        self._manners = manners
        self._clock = clock
        self._paused_until_s = 0.0  # by that clock
        self._quiet_until_s = 0.0  # wall time, after a failure
        self._lock = threading.Lock()

    def open(self) -> None:
        """Connect; the first question shows whether the instrument answers."""
        with self._lock:
            try:
                self._link.open(self._manners.timeout_s)
            except LinkError as err:
                raise LinkError(f"{self.who}: {self._link.address.left_out(err)}") from err

    def close(self) -> None:
        """Close the link after any running exchange; safe to call twice, and never raises."""
        with self._lock:
            self._link.close()

    def ask(self, query: str, *, skip: Callable[[str], bool] | None = None) -> str:
        """Return the line that answers a query; preceding lines that `skip` accepts are ignored."""
        return self._exchange(query, receive=partial(self._receive, skip), attempts=2)

    def ask_text(self, query: str, *, quiet_s: float) -> str:
        """Return an answer of several lines, joined by LF; it ends with `quiet_s` of wall time without a byte."""
        return self._exchange(query, receive=partial(self._receive_text, quiet_s), attempts=2)

    def tell(self, command: str, *, repeatable: bool = False) -> str:
        """Send a command; return the line that answers it, or "" if commands are not answered.

        `repeatable` permits a second attempt if no answer arrives: the command sets a value and does not change it by
        an amount.
        """
        receive = partial(self._receive, None) if self._manners.commands_answered else None
        return self._exchange(command, receive=receive, attempts=2 if repeatable else 1)

    def give_up(self, why: str) -> None:
        """Close the connection; the next exchange opens a new one, so that no late answer is taken for its own."""
        with self._lock:
            self._give_up(why)

    def last_heard(self) -> str:
        """Return the last traffic on the line, for an error message."""
        return f"last on the wire: {self._link.wire_log.tail(3)}"

    def _exchange(self, text: str, *, receive: Callable[[], str] | None, attempts: int) -> str:
        data = encode_line(text, self._manners.sent_end, encoding=self._manners.encoding)
        failure = ""
        with self._lock:
            for _ in range(attempts - 1):
                try:
                    return self._once(text, data, receive)
                except (LinkCutError, NoAnswerError) as err:
                    failure = str(err)
                    self._link.wire_log.note("asking again")
            answer = self._once(text, data, receive)
            if failure:
                note_recovered(failure)
                self._give_up("asked twice: a second answer may follow")
            return answer

    def _once(self, text: str, data: bytes, receive: Callable[[], str] | None) -> str:
        self._wait()
        try:
            self._link.send(data)
            return "" if receive is None else receive()
        except LinkCutError as err:
            self._give_up("given up: cut")
            why = self._link.address.left_out(err)
            raise LinkCutError(f"{self.who}: sent {text!r}, and the link broke: {why}; {self.last_heard()}") from err
        except NoAnswerError as err:
            self._give_up("given up: no answer in time")
            raise NoAnswerError(
                f"{self.who}: sent {text!r}, no answer within {self._manners.timeout_s:g} s; {self._manners.advice};"
                f" {self.last_heard()}"
            ) from err
        except LinkError as err:
            raise LinkError(f"{self.who}: could not send {text!r}: {self._link.address.left_out(err)}") from err
        except InstrumentError as err:
            self._give_up("given up: not a line")
            raise InstrumentError(
                f"{self.who}: sent {text!r}, expected a line: {err}; check that it is the right instrument"
            ) from err
        finally:
            self._paused_until_s = self._clock.now() + self._manners.pause_s

    def _wait(self) -> None:
        if (quiet_s := self._quiet_until_s - time.monotonic()) > 0:
            time.sleep(quiet_s)
        if self._manners.pause_s > 0 and (pause_s := self._paused_until_s - self._clock.now()) > 0:
            self._clock.sleep(pause_s)

    def _receive(self, skip: Callable[[str], bool] | None) -> str:
        lines = self._cutter()
        deadline_s = time.monotonic() + self._manners.timeout_s
        while (left_s := deadline_s - time.monotonic()) > 0:
            try:
                data = self._link.receive(4096, left_s)
            except LinkCutError:
                raise
            except LinkError as err:
                raise NoAnswerError(str(err)) from err
            answers = [line for line in lines.feed(data) if skip is None or not skip(line)]
            if answers:
                return answers[0]
        raise NoAnswerError("timed out before the answer was complete")

    def _receive_text(self, quiet_s: float) -> str:
        lines, received = self._cutter(), 0
        texts: list[str] = []
        while received < MAX_TEXT:
            try:
                data = self._link.receive(4096, quiet_s if received else self._manners.timeout_s)
            except LinkCutError:
                raise
            except LinkError as err:
                if not texts:
                    raise NoAnswerError(str(err)) from err
                break
            received += len(data)
            texts += lines.feed(data)
        return "\n".join(texts)

    def _cutter(self) -> LineCutter:
        return LineCutter(self._manners.answer_end, trimmed=self._manners.trimmed, encoding=self._manners.encoding)

    def _give_up(self, why: str) -> None:
        self._link.cut(why)
        self._quiet_until_s = time.monotonic() + QUIET_S
