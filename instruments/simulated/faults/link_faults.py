"""The faults of one link while a simulated instrument is served: counted over all its connections, played on each."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.faults.link_kinds import Answer, Exchange, LinkFault, Piece, at_once
from benchctl_instruments.simulated.faults.schedule import FaultLog, Fired, Schedule
from benchctl_instruments.simulated.faults.wires import Wire

if TYPE_CHECKING:
    from benchctl_instruments.simulated.tcp_server import Conversation


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
        self._where, self._wire, self._now, self._happen, self._log = where, wire, now, happen, log
        self._faults = [(fault, Schedule(fault.when)) for fault in faults]
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
            fault = self._due(request)
        if fault is None:
            return at_once(carry_out())
        exchange = Exchange(request=request, wire=self._wire, carry_out=carry_out, happen=self._happen)
        answer = fault.act(exchange)
        if answer.deaf_s:
            with self._lock:
                self._deaf_until_s = time.monotonic() + answer.deaf_s
        return answer

    def _due(self, request: bytes) -> LinkFault | None:
        operation, now_s = self._wire.shown(request), self._now()
        due = [fault for fault, schedule in self._faults if schedule.fires(operation, now_s)]
        if not due:
            return None
        self._log.note(Fired(bench_s=now_s, where=self._where, kind=due[0].kind, operation=operation))
        return due[0]


class FaultyConversation:
    """One connection's conversation, request by request."""

    def __init__(self, faults: LinkFaults, conversation: Conversation) -> None:
        self._faults = faults
        self._conversation = conversation
        self._held = Answer()

    def answer(self, data: bytes) -> Answer:
        """What leaves for what has arrived."""
        pieces: list[Piece] = []
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
        before = (Piece(data=late.held), Piece(data=b"", after_s=late.behind_s))
        return replace(answer, pieces=(*before, *answer.pieces))
