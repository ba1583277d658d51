"""One line there, one line back: an ACL dialogue over TCP. What the lines mean is the driver's business."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.links.recovered import note_recovered
from benchctl_instruments.links.tcp import LinkCutError, TcpLink
from benchctl_instruments.protocols.acl import Reply, ReplyReader, encode
from benchctl_instruments.protocols.lines import MOST_SHOWN, parse_number


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Numbers that are written by one command and read back by one query.

    `{axis}` and `{}` stand for the axis and the numbers. `tolerance` is how far an answer may be off, in the units of
    `name`; an answer that is off by a whole `turn` is not off.
    """

    name: str
    write: str
    ask: str
    tolerance: float
    turn: float = math.inf


class AclDialogue:
    """A dialogue with one axis of a controller; every exchange is safe from several threads.

    | what goes wrong                                   | what is done                                               |
    |---------------------------------------------------|------------------------------------------------------------|
    | no reply, a late one, half of one, a cut link     | asked once more, on a new connection; then `LinkError`     |
    | junk before or in a reply, a reply that is none   | asked once more, on a new connection; `InstrumentError`    |
    | junk behind a reply                               | thrown away                                                |
    | a reply in pieces                                 | put together                                               |
    | the controller restarts                           | connected again; it is then disabled, and says so          |
    | a refusal                                         | `InstrumentError`, with the fault that it reports          |

    A command is said again too, because it states what is to be and not by how much it is to change: all but those
    that are told `once`. After any failure the connection is given up, so that a late reply is never taken for the
    answer to the next question. ACL has no checksum: junk that is digits, beside or in a number, is not found out.

    Parameters
    ----------
    name
        How error messages call the instrument.
    link
        The link; the dialogue opens and closes it.
    axis
        What `{axis}` in commands and queries stands for.
    timeout_s
        How long to wait for a connection, and for a whole reply; wall time.
    terminator
        What ends a reply.
    explain
        Asked after a refusal: why, in words.
    """

    def __init__(
        self,
        name: str,
        link: TcpLink,
        *,
        axis: int,
        timeout_s: float,
        terminator: bytes,
        explain: Callable[[], str],
    ) -> None:
        self._name = name
        self._link = link
        self._axis = axis
        self._timeout_s = timeout_s
        self._terminator = terminator
        self._explain = explain
        self._lock = threading.Lock()

    def open(self) -> None:
        """Connect."""
        try:
            with self._lock:
                self._link.open(self._timeout_s)
        except LinkError as err:
            raise LinkError(f"{self._name}: {self._link.address.left_out(err)}") from err

    def close(self) -> None:
        """Let go of the link once no exchange is under way; safe to call twice, and never raises."""
        with self._lock:
            self._link.close()

    def ask(self, query: str) -> str:
        """What is said in reply to a query."""
        text = query.format(axis=self._axis)
        with self._lock:
            return self._exchange(text).data

    def numbers(self, query: str, count: int, parted_by: str = ",") -> tuple[float, ...]:
        """The finite numbers in reply to a query, exactly `count` of them."""
        said = self.ask(query)
        try:
            numbers = tuple(parse_number(word) for word in said.split(parted_by))
        except InstrumentError:
            numbers = ()
        if len(numbers) != count:
            wanted = f"{count} numbers parted by {parted_by!r}" if count > 1 else "a number"
            raise InstrumentError(
                f"{self._name}: asked {query.format(axis=self._axis)!r}, expected {wanted}, got {said[:MOST_SHOWN]!r};"
                " check that the controller speaks the dialect of the ACUTROL3000"
            )
        return numbers

    def tell(self, command: str, *values: float, once: bool = False) -> None:
        """Send a command; it must be acknowledged. `once`: it is not sent again where no acknowledgement comes."""
        text = command.format(*(f"{value:.6f}" for value in values), axis=self._axis)
        with self._lock:
            reply = self._attempt(text) if once else self._exchange(text)
        if not reply.ok:
            raise InstrumentError(
                f"{self._name}: sent {text!r}, expected OK, got {reply.data[:MOST_SHOWN]!r}; {self._explain()}"
            )

    def write(self, setting: Setting, *values: float) -> None:
        """Send numbers and read them back."""
        self.tell(setting.write, *values)
        self.expect(setting, *values)

    def expect(self, setting: Setting, *wanted: float) -> None:
        """Read numbers back."""
        actual = self.numbers(setting.ask, len(wanted))
        errors = (math.remainder(a - w, setting.turn) for a, w in zip(actual, wanted, strict=True))
        if any(abs(error) > setting.tolerance for error in errors):
            raise InstrumentError(
                f"{self._name}: {setting.name} should be {_listed(wanted)}, it acknowledged and reads back"
                f" {_listed(actual)}; check the controller's limits, and that nothing else commands it"
            )

    def _exchange(self, text: str) -> Reply:
        try:
            return self._attempt(text)
        except (LinkError, InstrumentError) as err:
            self._link.wire_log.note("asking again")
            reply = self._attempt(text)
            note_recovered(str(err))
            return reply

    def _attempt(self, text: str) -> Reply:
        try:
            self._link.send(encode(text))
            return self._receive()
        except LinkCutError as err:
            says = self._link.address.left_out(err)
            raise LinkCutError(f"{self._name}: sent {text!r}, expected a reply: {says}; {self._last_heard()}") from err
        except LinkError as err:
            self._link.cut("given up: no reply in time")
            raise LinkError(
                f"{self._name}: sent {text!r}, no reply within {self._timeout_s:g} s; check that the controller"
                f" is in remote mode and that nobody else holds its link; {self._last_heard()}"
            ) from err
        except InstrumentError as err:
            self._link.cut("given up: not ACL")
            raise InstrumentError(
                f"{self._name}: sent {text!r}, expected an ACL reply: {err}; check that the address is an ACUTROL3000's"
            ) from err

    def _receive(self) -> Reply:
        reader = ReplyReader(self._terminator)
        deadline_s = time.monotonic() + self._timeout_s
        while True:
            data = self._link.receive(4096, deadline_s - time.monotonic())
            if not data.isascii():
                raise InstrumentError(f"bytes that are no ASCII, {data[:32]!r}")
            if replies := reader.feed(data):
                return replies[0]

    def _last_heard(self) -> str:
        return f"last on the wire: {self._link.wire_log.tail(3)}"


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.6g}" for value in values)
