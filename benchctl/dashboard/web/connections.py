"""Connections below HTTP: how many there may be, how long one may keep us waiting, and who goes where there is no room.

A connection on which it is the client's turn, to ask or to take its answer, gives way: the one on which the client has
done nothing for longest goes when a new one comes. So a thousand that say nothing, ask by halves or do not read keep
nobody out. Only where all are being answered is the new one refused.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState

AT_ONCE = 128
"""How many the system keeps waiting, and so the most that come in one turn of the loop."""
MOST_CONNECTIONS = 3 * AT_ONCE
"""Two turns pass before what one asks is read: with fewer, others that come meanwhile would push it out unheard."""
IDLE_S = 20.0
"""Within which a request must have come, whole headers and all, since the connection or the answer before."""
STALLED_S = 20.0
"""After which a reader that takes nothing is let go."""
ANSWER_WITHIN_S = 180.0
"""Within which an answer must have been taken, however slowly."""

_FULL = b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-length: 0\r\nretry-after: 5\r\n\r\n"


class Connection(H11Protocol):
    """A connection that speaks HTTP/1.1, one of at most `MOST_CONNECTIONS`."""

    cycle: RequestResponseCycle | None  # type: ignore[assignment]  # None before the first request
    idle_since_s = 0.0
    """Since when no request is being answered."""
    active_s = 0.0
    """When the client last sent or took anything."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # narrower in uvicorn
        """See `asyncio.Protocol`."""
        super().connection_made(transport)
        self.idle_since_s = self.active_s = self.loop.time()
        if len(self.connections) > MOST_CONNECTIONS:
            self._make_room()

    def data_received(self, data: bytes) -> None:
        """See `asyncio.Protocol`."""
        self.active_s = self.loop.time()
        super().data_received(data)

    def resume_writing(self) -> None:
        """See `asyncio.Protocol`."""
        self.active_s = self.loop.time()
        super().resume_writing()

    def on_response_complete(self) -> None:
        """See `H11Protocol`."""
        self.idle_since_s = self.active_s = self.loop.time()
        super().on_response_complete()

    @property
    def is_idle(self) -> bool:
        """Whether no request is being answered."""
        return self.cycle is None or self.cycle.response_complete

    @property
    def waits_for_client(self) -> bool:
        """Whether it is the client's turn: to ask, to go on asking, or to take its answer."""
        return self.cycle is None or self.is_idle or self.cycle.more_body or self.flow.write_paused

    def _make_room(self) -> None:
        others = (other for other in self.connections if isinstance(other, Connection) and other is not self)
        waiting = [other for other in others if other.waits_for_client]
        if waiting:
            let_go = min(waiting, key=lambda other: other.active_s)
            let_go.transport.abort()
        else:
            let_go = self
            self.transport.write(_FULL)
            self.transport.close()
        self.connections.discard(let_go)  # at once, not only once it is lost: many may come in one turn of the loop


class Socket(WebSocketsSansIOProtocol):
    """A websocket, or one that was asked for and refused."""

    async def send(self, message: Any) -> None:
        """See ASGI."""
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True  # by the answer that refuses it; else each one is logged as a fault


@dataclass(slots=True)
class _Buffer:
    """What a connection has still to take: how much, since when it was not less, since when it was not nothing."""

    size: int
    same_since_s: float
    since_s: float


async def sweep(state: ServerState) -> None:
    """Once a second, let go of who sends no request and who does not take the answer; runs until cancelled."""
    buffers: dict[object, _Buffer] = {}
    while True:
        now_s = asyncio.get_running_loop().time()
        seen: dict[object, _Buffer] = {}
        for connection in list(state.connections):
            transport = connection.transport
            size = transport.get_write_buffer_size()
            if size:
                before = buffers.get(connection, _Buffer(size, now_s, now_s))
                same_since_s = before.same_since_s if before.size == size else now_s
                seen[connection] = _Buffer(size, same_since_s, before.since_s)
                late = isinstance(connection, Connection) and now_s - before.since_s > ANSWER_WITHIN_S
                if late or now_s - same_since_s > STALLED_S:
                    transport.abort()
            elif isinstance(connection, Connection) and connection.is_idle and now_s - connection.idle_since_s > IDLE_S:
                transport.abort()
        buffers = seen
        await asyncio.sleep(1.0)
