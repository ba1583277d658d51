"""A threaded TCP server for simulated instruments: it knows connections, and nothing of what is said on them."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from collections.abc import Callable
from typing import Protocol, Self

from benchctl_instruments.errors import UsageError, reason
from benchctl_instruments.simulated.faults.link_faults import Conversation, FaultyConversation, LinkFaults

Where = tuple[str, int]
"""Host and port; port 0 takes a free one."""


def address_of(where: Where) -> str:
    """`tcp://HOST:PORT`, an IPv6 host in brackets."""
    host, port = where
    return f"tcp://{f'[{host}]' if ':' in host else host}:{port}"


def listen(where: Where) -> tuple[socket.socket, Where]:
    """A listening socket, and where it really listens; `UsageError` where the port is taken or may not be used."""
    host = where[0]
    try:
        listener = socket.create_server(where, family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as err:
        raise UsageError(f"cannot listen at {address_of(where)}: {reason(err)}; choose another port, or 0") from err
    listener.setblocking(False)
    return listener, (host, listener.getsockname()[1])


_SLICE_S = 0.005  # a paced reply leaves in slices of this much line time
_BITS_PER_BYTE = 10  # start, eight data, stop


class Startable(Protocol):
    """What serves from `start()` to `stop()`, or in a `with`."""

    def start(self) -> None:
        """Serve; when it returns, a client can connect."""

    def stop(self) -> None:
        """Stop serving; safe to call twice."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()


class TcpServer(Startable):
    """Serves one `Conversation` per connection, each on a daemon thread of its own.

    Parameters
    ----------
    converse
        Makes the conversation of a new connection.
    host, port
        Where to listen; port 0 takes a free one, `address` then says which.
    pace_baud
        Replies leave no faster than a serial line of that many bits a second lets them (10 bits a byte, wall time).

    Attributes
    ----------
    faults
        What befalls the requests on connections that are made from now on; None: nothing.
    """

    def __init__(
        self,
        converse: Callable[[], Conversation],
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        pace_baud: int | None = None,
    ) -> None:
        self.faults: LinkFaults | None = None
        self._converse = converse
        self._where = (host, port)
        self._pace_baud = pace_baud
        self._listener: socket.socket | None = None
        self._acceptor: threading.Thread | None = None
        self._wake: socket.socket | None = None
        self._stopping = threading.Event()
        self._away_until_s = 0.0  # by the wall: until then it does not listen
        self._gone = threading.Event()
        self._lock = threading.Lock()
        self._connections: dict[socket.socket, threading.Thread] = {}

    @property
    def address(self) -> str:
        """`tcp://HOST:PORT`, with the port that was really taken once it runs."""
        return address_of(self._where)

    def start(self) -> None:
        """Listen; when it returns, a client can connect."""
        if self._listener is not None:
            return
        listener, self._where = listen(self._where)
        self._wake, awake = socket.socketpair()
        self._stopping.clear()
        self._listener = listener
        self._acceptor = threading.Thread(
            target=self._accept, args=(listener, awake), name=f"accept {self.address}", daemon=True
        )
        self._acceptor.start()

    def stop(self) -> None:
        """Close everything and join every thread; safe to call twice. `start` serves at the same port again."""
        self._stopping.set()
        if self._acceptor is not None and self._wake is not None:
            with contextlib.suppress(OSError):  # it was away, and has ended by itself
                self._wake.send(b"!")
            self._acceptor.join()
            self._wake.close()
        self._listener = self._acceptor = self._wake = None
        self.cut_connections()

    def cut_connections(self) -> None:
        """Close every present connection, as a pulled cable does, and go on listening."""
        with self._lock:
            present = dict(self._connections)
        for connection, thread in present.items():
            with contextlib.suppress(OSError):  # it may have ended by itself meanwhile
                connection.shutdown(socket.SHUT_RDWR)
            if thread is not threading.current_thread():
                thread.join()

    def _accept(self, listener: socket.socket, awake: socket.socket) -> None:
        with awake:
            while True:
                with listener:
                    self._accept_until_woken(listener, awake)
                self._gone.set()
                if self._stopping.wait(max(0.0, self._away_until_s - time.monotonic())):
                    return
                self._gone.clear()
                listener, _ = listen(self._where)

    def _accept_until_woken(self, listener: socket.socket, awake: socket.socket) -> None:
        while True:
            ready, _, _ = select.select([listener, awake], [], [])
            if awake in ready:
                awake.recv(1)
                return
            with contextlib.suppress(OSError):  # a client that gave up before it was accepted
                connection, _ = listener.accept()
                self._begin(connection)

    def _begin(self, connection: socket.socket) -> None:
        connection.setblocking(True)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        thread = threading.Thread(target=self._serve, args=(connection,), name=f"serve {self.address}", daemon=True)
        with self._lock:
            self._connections[connection] = thread
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        try:
            if self.faults is None:
                self._talk(connection, self._converse())
            else:
                self._talk_with_faults(connection, self.faults.on(self._converse()))
        except ConnectionError:
            pass  # the client went away, or the connection was cut: either way it is over
        finally:
            with self._lock:
                del self._connections[connection]
            connection.close()

    def _talk(self, connection: socket.socket, conversation: Conversation) -> None:
        while data := connection.recv(65536):
            self._send(connection, conversation.feed(data))

    def _talk_with_faults(self, connection: socket.socket, conversation: FaultyConversation) -> None:
        while data := connection.recv(65536):
            answer = conversation.answer(data)
            for piece in answer.pieces:
                if piece.after_s and self._stopping.wait(piece.after_s):
                    return
                self._send(connection, piece.data)
            if answer.gone:
                self._go_away(answer.deaf_s)
            if answer.cut or answer.gone:
                return

    def _go_away(self, for_s: float) -> None:
        """Stop listening for a while, and end every connection; the caller ends its own."""
        if self._stopping.is_set() or self._wake is None:
            return
        self._away_until_s = time.monotonic() + for_s
        with contextlib.suppress(OSError):  # it is being stopped at this moment
            self._wake.send(b"!")
        self._gone.wait(for_s)
        self.cut_connections()

    def _send(self, connection: socket.socket, reply: bytes) -> None:
        if self._pace_baud is None:
            connection.sendall(reply)
        else:
            self._send_paced(connection, reply, self._pace_baud)

    def _send_paced(self, connection: socket.socket, reply: bytes, baud: int) -> None:
        """The last byte of a slice arrives when a line would have carried it."""
        size = max(1, int(baud * _SLICE_S / _BITS_PER_BYTE))
        started_s = time.monotonic()
        for first in range(0, len(reply), size):
            piece = reply[first : first + size]
            due_s = started_s + (first + len(piece)) * _BITS_PER_BYTE / baud
            if self._stopping.wait(max(0.0, due_s - time.monotonic())):
                return
            connection.sendall(piece)
