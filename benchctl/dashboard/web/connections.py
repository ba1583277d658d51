"""Limits on connections below HTTP: their number, their idle time, and which one is closed if there is no room.

A connection that waits for its client, to send a request or to read the response, may be closed: if a new connection
exceeds the limit, the one whose client has been inactive for the longest time is closed. Therefore many connections
that send nothing, send incomplete requests or do not read cannot lock out other clients. The new connection is refused
only if all others are being served.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState

AT_ONCE = 128
"""Length of the system's queue, and therefore the maximum of new connections in one iteration of the event loop."""
MOST_CONNECTIONS = 3 * AT_ONCE
"""A request is read two iterations after its connection: with fewer, it could be displaced before it is read."""
IDLE_S = 20.0
"""Time limit for a complete request including headers, from the start of the connection or the previous response."""
STALLED_S = 20.0
"""Time after which a connection is closed if the client reads nothing."""
ANSWER_WITHIN_S = 180.0
"""Time limit for reading a complete response."""

_FULL = b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-length: 0\r\nretry-after: 5\r\n\r\n"


class Connection(H11Protocol):
    """An HTTP/1.1 connection, one of at most `MOST_CONNECTIONS`."""

    cycle: RequestResponseCycle | None  # type: ignore[assignment]  # None before the first request
    idle_since_s = 0.0
    """Start of the time without a request in progress."""
    active_s = 0.0
    """Time of the client's last activity."""

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
        """Whether no request is in progress."""
        return self.cycle is None or self.cycle.response_complete

    @property
    def waits_for_client(self) -> bool:
        """Whether the connection waits for the client: to send a request or the rest of it, or to read the response."""
        return self.cycle is None or self.is_idle or self.cycle.more_body or self.flow.write_paused

    def _make_room(self) -> None:
        others = (other for other in self.connections if isinstance(other, Connection) and other is not self)
        waiting = [other for other in others if other.waits_for_client]
        if waiting:
            closed = min(waiting, key=lambda other: other.active_s)
            closed.transport.abort()
        else:
            closed = self
            self.transport.write(_FULL)
            self.transport.close()
        self.connections.discard(
            closed
        )  # immediately, not when it is reported lost: many may arrive in one iteration of the loop


class Socket(WebSocketsSansIOProtocol):
    """A websocket, or a refused request for one."""

    async def send(self, message: Any) -> None:
        """See ASGI."""
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True  # by the refusal; otherwise each one is logged as an error


@dataclass(slots=True)
class _Buffer:
    """The unsent bytes of a connection: their number, the time of its last change, the time since which it is not 0."""

    size: int
    same_since_s: float
    since_s: float


async def sweep(state: ServerState) -> None:
    """Once a second, close connections whose client sends no request or reads no response; runs until cancelled."""
    buffers: dict[object, _Buffer] = {}
    while True:
        now_s = asyncio.get_running_loop().time()
        current: dict[object, _Buffer] = {}
        for connection in list(state.connections):
            transport = connection.transport
            size = transport.get_write_buffer_size()
            if size:
                before = buffers.get(connection, _Buffer(size, now_s, now_s))
                same_since_s = before.same_since_s if before.size == size else now_s
                current[connection] = _Buffer(size, same_since_s, before.since_s)
                late = isinstance(connection, Connection) and now_s - before.since_s > ANSWER_WITHIN_S
                if late or now_s - same_since_s > STALLED_S:
                    transport.abort()
            elif isinstance(connection, Connection) and connection.is_idle and now_s - connection.idle_since_s > IDLE_S:
                transport.abort()
        buffers = current
        await asyncio.sleep(1.0)
