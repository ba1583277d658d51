"""The faults of one link while a simulated instrument is served: counted over all its connections, played on each.

Each kind makes of one request, and its true answer, what comes of it instead.
"""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Protocol

from pydantic import Field, field_validator

from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.faults.schedule import FaultLog, FaultTable, PendingFaults, Place, Positive
from benchctl_instruments.simulated.faults.wires import Wire


class Conversation(Protocol):
    """One connection's side of a protocol, without I/O: bytes that came in, bytes to send back."""

    def feed(self, data: bytes) -> bytes:
        """Take what arrived, however it was cut into packets, and answer what is complete; b"" where nothing is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """A request as it has come in.

    `carry_out` has the instrument obey it and gives its true answer, b"" where it has none; to be called at most once.
    `happen` does to the instrument what a hand or the world does: "open_interlock", "following_error", "restart".
    """

    request: bytes
    wire: Wire
    carry_out: Callable[[], bytes]
    happen: Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayedBytes:
    """Bytes that leave `after_s` of wall time after what was before them."""

    data: bytes
    after_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What leaves for one request.

    `held` waits for the next request on the same connection and leaves `behind_s` of wall time before the answer to
    that. With `cut` the
    connection ends after the pieces. For `deaf_s` of wall time from now on the instrument hears nothing on any
    connection; with `gone` it does not listen either, and every connection ends.
    """

    pieces: tuple[DelayedBytes, ...] = ()
    held: bytes = b""
    behind_s: float = 0.0
    cut: bool = False
    deaf_s: float = 0.0
    gone: bool = False


def at_once(data: bytes) -> Answer:
    """The whole answer without delay."""
    return Answer(pieces=(DelayedBytes(data=data),))


class LinkFault(FaultTable):
    """A fault that befalls a request; `needs` names what the wire's protocol must have for it."""

    needs: ClassVar[str] = ""

    @abstractmethod
    def act(self, exchange: Exchange) -> Answer:
        """What comes of the request."""


class Silence(LinkFault):
    """The request is carried out, its answer never comes."""

    kind: Literal["silence"] = "silence"

    def act(self, exchange: Exchange) -> Answer:
        """Nothing leaves."""
        exchange.carry_out()
        return Answer()


class LostRequest(LinkFault):
    """The request never arrives."""

    kind: Literal["lost_request"] = "lost_request"

    def act(self, exchange: Exchange) -> Answer:
        """Nothing is done, nothing leaves."""
        return Answer()


class Late(LinkFault):
    """The answer comes when the client has asked again, `behind_s` of wall time before the answer to that."""

    kind: Literal["late"] = "late"
    behind_s: Positive = 0.03

    def act(self, exchange: Exchange) -> Answer:
        """The answer is held back."""
        return Answer(held=exchange.carry_out(), behind_s=self.behind_s)


class Slow(LinkFault):
    """The answer comes `delay_s` of wall time later, and with it all that was asked meanwhile."""

    kind: Literal["slow"] = "slow"
    delay_s: Positive = 0.3

    def act(self, exchange: Exchange) -> Answer:
        """The answer, after a while."""
        return Answer(pieces=(DelayedBytes(data=exchange.carry_out(), after_s=self.delay_s),))


class _Spoilt(LinkFault):
    """The answer is what the wire's own way to spoil it, the one that is needed, makes of it."""

    def act(self, exchange: Exchange) -> Answer:
        """The answer, spoilt."""
        answer, spoil = exchange.carry_out(), getattr(exchange.wire, self.needs)
        return at_once(spoil(answer) if answer and spoil else answer)


class OtherUnit(_Spoilt):
    """Another unit answers in its place: the answer comes under another unit's number."""

    kind: Literal["other_unit"] = "other_unit"
    needs = "other_unit"


class BadChecksum(_Spoilt):
    """The answer's checksum is wrong."""

    kind: Literal["bad_checksum"] = "bad_checksum"
    needs = "bad_checksum"


class HalfFloat(_Spoilt):
    """The answer to a read lacks its last register, and is sound otherwise: half of a float."""

    kind: Literal["half_float"] = "half_float"
    needs = "half_float"


class Refusal(LinkFault):
    """The instrument refuses what it would do at another time; `code` is Modbus' exception code."""

    kind: Literal["refusal"] = "refusal"
    needs = "refusal"
    code: int = Field(default=4, ge=1, le=255)

    def act(self, exchange: Exchange) -> Answer:
        """Nothing is done, and that is said."""
        refuse = exchange.wire.refusal
        return at_once(refuse(exchange.request, self.code) if refuse else b"")


class Junk(LinkFault):
    """Bytes that nobody sent stand before, in or after the answer; `junk` is them in hex."""

    kind: Literal["junk_before", "junk_in", "junk_after"]
    junk: str = "ff 00 5a"

    @field_validator("junk")
    @classmethod
    def _is_hex(cls, value: str) -> str:
        bytes.fromhex(value)
        return value

    def act(self, exchange: Exchange) -> Answer:
        """The answer, and the junk in its place."""
        answer = exchange.carry_out()
        place = {"junk_before": 0, "junk_in": len(answer) // 2, "junk_after": len(answer)}[self.kind]
        return at_once(answer[:place] + bytes.fromhex(self.junk) + answer[place:])


class Split(LinkFault):
    """The answer comes in two pieces, `gap_s` of wall time apart."""

    kind: Literal["split"] = "split"
    gap_s: Positive = 0.02

    def act(self, exchange: Exchange) -> Answer:
        """The two halves."""
        answer = exchange.carry_out()
        middle = len(answer) // 2
        return Answer(
            pieces=(DelayedBytes(data=answer[:middle]), DelayedBytes(data=answer[middle:], after_s=self.gap_s))
        )


class Cut(LinkFault):
    """The answer breaks off in its middle; a TCP connection ends there."""

    kind: Literal["cut"] = "cut"

    def act(self, exchange: Exchange) -> Answer:
        """Half of the answer, and no more."""
        answer = exchange.carry_out()
        return Answer(pieces=(DelayedBytes(data=answer[: len(answer) // 2]),), cut=True)


class PulledCable(LinkFault):
    """For `for_s` of wall time nothing gets through: not this request, and no other, on whatever connection."""

    kind: Literal["pulled_cable"] = "pulled_cable"
    for_s: Positive = 0.5

    def act(self, exchange: Exchange) -> Answer:
        """Nothing is done, nothing leaves."""
        return Answer(deaf_s=self.for_s)


class Restart(LinkFault):
    """The instrument starts anew: for `for_s` of wall time it is not there, then it is, as it is after power-on.

    Its connections end, and new ones are refused meanwhile; a serial line is silent. What an instrument forgets when it
    restarts is its twin's business.
    """

    kind: Literal["restart"] = "restart"
    for_s: Positive = 0.3

    def act(self, exchange: Exchange) -> Answer:
        """Nothing is done, nothing leaves, and what was in the instrument's memory is gone."""
        exchange.happen("restart")
        return Answer(deaf_s=self.for_s, gone=True)


class TableTrips(LinkFault):
    """Before the request is carried out the table is tripped: by hand at its interlock, or by its following error."""

    places: ClassVar[tuple[Place, ...]] = ("rate_table",)

    kind: Literal["interlock_opened", "following_error"]

    def act(self, exchange: Exchange) -> Answer:
        """The true answer of a table that has just tripped."""
        exchange.happen({"interlock_opened": "open_interlock", "following_error": "trip"}[self.kind])
        return at_once(exchange.carry_out())


AnyLinkFault = (
    Silence
    | LostRequest
    | Late
    | Slow
    | OtherUnit
    | BadChecksum
    | HalfFloat
    | Refusal
    | Junk
    | Split
    | Cut
    | PulledCable
    | Restart
    | TableTrips
)


class LinkFaults:
    """What befalls the requests on one link. Of several faults that are due at one request the first one happens.

    Parameters
    ----------
    where
        The link's name, as the log states it.
    faults
        In the order in which they are looked at; every one counts every request.
    wire
        The link's protocol.
    now
        Bench time.
    happen
        Does to the instrument what the world does to it: `Exchange.happen`.
    log
        Where to note what has happened.
    """

    def __init__(
        self,
        where: str,
        faults: Sequence[LinkFault],
        *,
        wire: Wire,
        now: Callable[[], float],
        happen: Callable[[str], None],
        log: FaultLog,
    ) -> None:
        for fault in faults:
            if fault.needs and getattr(wire, fault.needs) is None:
                raise UsageError(
                    f"faults: {fault.kind} cannot happen to the {where} that was chosen: its protocol has nothing"
                    " that could be wrong in that way; choose another kind"
                )
        self._wire, self._now, self._happen = wire, now, happen
        self._faults = PendingFaults(where, faults, log)
        self._lock = threading.Lock()
        self._deaf_until_s = 0.0  # by the wall

    def on(self, conversation: Conversation) -> FaultyConversation:
        """A connection's conversation, with the link's faults."""
        return FaultyConversation(self, conversation)

    def requests(self, data: bytes) -> list[bytes]:
        """What has arrived at once, taken apart into requests."""
        return self._wire.requests(data)

    def answer(self, request: bytes, carry_out: Callable[[], bytes]) -> Answer:
        """What comes of a request on whatever connection."""
        with self._lock:
            if time.monotonic() < self._deaf_until_s:
                return Answer()
            fault = self._faults.due(self._wire.shown(request), self._now())
        if fault is None:
            return at_once(carry_out())
        exchange = Exchange(request=request, wire=self._wire, carry_out=carry_out, happen=self._happen)
        answer = fault.act(exchange)
        if answer.deaf_s:
            with self._lock:
                self._deaf_until_s = time.monotonic() + answer.deaf_s
        return answer


class FaultyConversation:
    """One connection's conversation, request by request."""

    def __init__(self, faults: LinkFaults, conversation: Conversation) -> None:
        self._faults = faults
        self._conversation = conversation
        self._held = Answer()

    def answer(self, data: bytes) -> Answer:
        """What leaves for what has arrived."""
        pieces: list[DelayedBytes] = []
        answer = Answer()
        for request in self._faults.requests(data):
            answer = self._answer(request)
            pieces += answer.pieces
            if answer.cut or answer.gone:
                break
        return replace(answer, pieces=tuple(pieces))

    def _answer(self, request: bytes) -> Answer:
        """What leaves for a request, an answer that was held back before it."""
        answer = self._faults.answer(request, lambda: self._conversation.feed(request))
        late, self._held = self._held, answer
        if not late.held:
            return answer
        before = (DelayedBytes(data=late.held), DelayedBytes(data=b"", after_s=late.behind_s))
        return replace(answer, pieces=(*before, *answer.pieces))
