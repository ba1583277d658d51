"""The faults of one link of a simulated instrument: counted over all its connections, played on each.

Each kind of fault replaces the true answer to a request.
"""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Protocol

from pydantic import Field, field_validator

from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.faults.schedule import LASTS, FaultTable, Fired, PendingFaults, Place, Positive
from benchctl_instruments.simulated.faults.wires import Wire


class Conversation(Protocol):
    """One connection's side of a protocol, without I/O: received bytes in, bytes to send out."""

    def feed(self, data: bytes) -> bytes:
        """Add received bytes, cut anywhere, and return the answers to complete requests, or b""."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """A received request.

    `carry_out` makes the instrument execute it and returns its true answer, b"" if there is none; call it at most once.
    `happen` applies an external event to the instrument: "open_interlock", "following_error", "restart".
    """

    request: bytes
    wire: Wire
    carry_out: Callable[[], bytes]
    happen: Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayedBytes:
    """Bytes that are sent `after_s` of wall time after the preceding ones."""

    data: bytes
    after_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The bytes sent for one request.

    `held` is kept until the next request on the same connection and is sent `behind_s` of wall time before the answer
    to that. With `cut` the connection ends after the pieces. For `deaf_s` of wall time from now on the instrument
    receives nothing on any connection; with `gone` it does not listen either, and every connection ends.
    """

    pieces: tuple[DelayedBytes, ...] = ()
    held: bytes = b""
    behind_s: float = 0.0
    cut: bool = False
    deaf_s: float = 0.0
    gone: bool = False


def at_once(data: bytes) -> Answer:
    """Return the complete answer without delay."""
    return Answer(pieces=(DelayedBytes(data=data),))


class LinkFault(FaultTable):
    """A fault of a request; `needs` names the property that the wire's protocol must have."""

    needs: ClassVar[str] = ""

    @abstractmethod
    def act(self, exchange: Exchange) -> Answer:
        """Return the answer to the request."""


class Silence(LinkFault):
    """The request is executed, but its answer is lost."""

    kind: Literal["silence"] = "silence"

    def act(self, exchange: Exchange) -> Answer:
        """Return no bytes."""
        exchange.carry_out()
        return Answer()


class LostRequest(LinkFault):
    """The request is lost."""

    kind: Literal["lost_request"] = "lost_request"

    def act(self, exchange: Exchange) -> Answer:
        """Execute nothing and return no bytes."""
        return Answer()


class Late(LinkFault):
    """The answer is sent after the client's next request, `behind_s` of wall time before the answer to that."""

    kind: Literal["late"] = "late"
    behind_s: Positive = Field(
        default=0.03, title="Behind", description="So long before the answer to the repeated request (wall time)."
    )

    def act(self, exchange: Exchange) -> Answer:
        """Hold the answer back."""
        return Answer(held=exchange.carry_out(), behind_s=self.behind_s)


class Slow(LinkFault):
    """The answer is sent `delay_s` of wall time later, and so are the answers to all requests received meanwhile."""

    kind: Literal["slow"] = "slow"
    delay_s: Positive = Field(default=0.3, title="Delay", description="So much later (wall time).")

    def act(self, exchange: Exchange) -> Answer:
        """Return the answer with a delay."""
        return Answer(pieces=(DelayedBytes(data=exchange.carry_out(), after_s=self.delay_s),))


class _Spoilt(LinkFault):
    """The answer is corrupted by the wire's function that `needs` names."""

    def act(self, exchange: Exchange) -> Answer:
        """Return the corrupted answer."""
        answer, spoil = exchange.carry_out(), getattr(exchange.wire, self.needs)
        return at_once(spoil(answer) if answer and spoil else answer)


class OtherUnit(_Spoilt):
    """Another unit answers instead: the answer has another unit's number."""

    kind: Literal["other_unit"] = "other_unit"
    needs = "other_unit"


class BadChecksum(_Spoilt):
    """The answer's checksum is wrong."""

    kind: Literal["bad_checksum"] = "bad_checksum"
    needs = "bad_checksum"


class HalfFloat(_Spoilt):
    """The answer to a read lacks its last register and is otherwise valid: half of a float."""

    kind: Literal["half_float"] = "half_float"
    needs = "half_float"


class Refusal(LinkFault):
    """The instrument refuses the request; `code` is Modbus' exception code."""

    kind: Literal["refusal"] = "refusal"
    needs = "refusal"
    code: int = Field(default=4, ge=1, le=255, description="Modbus' exception code.")

    def act(self, exchange: Exchange) -> Answer:
        """Execute nothing and return a refusal."""
        refuse = exchange.wire.refusal
        return at_once(refuse(exchange.request, self.code) if refuse else b"")


class Junk(LinkFault):
    """Junk bytes appear before, in or after the answer; `junk` is their hex text."""

    kind: Literal["junk_before", "junk_in", "junk_after"]
    junk: str = Field(default="ff 00 5a", description="The bytes, in hex.")

    @field_validator("junk")
    @classmethod
    def _is_hex(cls, value: str) -> str:
        bytes.fromhex(value)
        return value

    def act(self, exchange: Exchange) -> Answer:
        """Return the answer with the junk in its place."""
        answer = exchange.carry_out()
        place = {"junk_before": 0, "junk_in": len(answer) // 2, "junk_after": len(answer)}[self.kind]
        return at_once(answer[:place] + bytes.fromhex(self.junk) + answer[place:])


class Split(LinkFault):
    """The answer is sent in two pieces, `gap_s` of wall time apart."""

    kind: Literal["split"] = "split"
    gap_s: Positive = Field(default=0.02, title="Gap", description="Between the two pieces (wall time).")

    def act(self, exchange: Exchange) -> Answer:
        """Return the two halves."""
        answer = exchange.carry_out()
        middle = len(answer) // 2
        return Answer(
            pieces=(DelayedBytes(data=answer[:middle]), DelayedBytes(data=answer[middle:], after_s=self.gap_s))
        )


class Cut(LinkFault):
    """The answer is cut in its middle; a TCP connection ends there."""

    kind: Literal["cut"] = "cut"

    def act(self, exchange: Exchange) -> Answer:
        """Return half of the answer."""
        answer = exchange.carry_out()
        return Answer(pieces=(DelayedBytes(data=answer[: len(answer) // 2]),), cut=True)


class PulledCable(LinkFault):
    """For `for_s` of wall time all requests are lost: this one, and others on any connection."""

    kind: Literal["pulled_cable"] = "pulled_cable"
    for_s: Annotated[Positive, LASTS] = 0.5

    def act(self, exchange: Exchange) -> Answer:
        """Execute nothing and return no bytes."""
        return Answer(deaf_s=self.for_s)


class Restart(LinkFault):
    """The instrument restarts: for `for_s` of wall time it is absent, then it is in its state after power-on.

    Its connections end, and new ones are refused meanwhile; a serial line is silent. The twin determines what an
    instrument loses by a restart.
    """

    kind: Literal["restart"] = "restart"
    for_s: Annotated[Positive, LASTS] = 0.3

    def act(self, exchange: Exchange) -> Answer:
        """Execute nothing, return no bytes, and reset the instrument's volatile state."""
        exchange.happen("restart")
        return Answer(deaf_s=self.for_s, gone=True)


class TableTrips(LinkFault):
    """Before the request is executed the table is tripped: by its interlock, or by its following error."""

    places: ClassVar[tuple[Place, ...]] = ("rate_table",)

    kind: Literal["interlock_opened", "following_error"]

    def act(self, exchange: Exchange) -> Answer:
        """Return the true answer of a table that has just tripped."""
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
    """The faults of the requests on one link. If several faults are due at one request, the first one happens.

    Parameters
    ----------
    where
        The link's name in the log.
    faults
        In the order in which they are checked; every one counts every request.
    wire
        The link's protocol.
    now
        Bench time.
    happen
        Applies an external event to the instrument: `Exchange.happen`.
    log
        The log of faults that have happened.
    """

    def __init__(
        self,
        where: str,
        faults: Sequence[LinkFault],
        *,
        wire: Wire,
        now: Callable[[], float],
        happen: Callable[[str], None],
        log: list[Fired],
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
        self._deaf_until_s = 0.0  # wall time

    def on(self, conversation: Conversation) -> FaultyConversation:
        """Return a connection's conversation with the link's faults."""
        return FaultyConversation(self, conversation)

    def requests(self, data: bytes) -> list[bytes]:
        """Split bytes that arrived together into requests."""
        return self._wire.requests(data)

    def answer(self, request: bytes, carry_out: Callable[[], bytes]) -> Answer:
        """Return the answer to a request on any connection."""
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
    """One connection's conversation with faults, request by request."""

    def __init__(self, faults: LinkFaults, conversation: Conversation) -> None:
        self._faults = faults
        self._conversation = conversation
        self._held = Answer()

    def answer(self, data: bytes) -> Answer:
        """Return what is sent for the received bytes."""
        pieces: list[DelayedBytes] = []
        answer = Answer()
        for request in self._faults.requests(data):
            answer = self._answer(request)
            pieces += answer.pieces
            if answer.cut or answer.gone:
                break
        return replace(answer, pieces=tuple(pieces))

    def _answer(self, request: bytes) -> Answer:
        """Return what is sent for a request, preceded by an answer that was held back."""
        answer = self._faults.answer(request, lambda: self._conversation.feed(request))
        late, self._held = self._held, answer
        if not late.held:
            return answer
        before = (DelayedBytes(data=late.held), DelayedBytes(data=b"", after_s=late.behind_s))
        return replace(answer, pieces=(*before, *answer.pieces))
