"""A threaded TCP server for simulated instruments: it handles connections, independent of their protocol."""

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

HOST = "127.0.0.1"


def address_of(port: int) -> str:
    """Return `tcp://HOST:PORT`."""
    return f"tcp://{HOST}:{port}"


def listen(port: int) -> tuple[socket.socket, int]:
    """Return a listening socket and its port; raises `UsageError` if the port is in use or not permitted."""
    try:
        listener = socket.create_server((HOST, port))
    except OSError as err:
        raise UsageError(f"cannot listen at {address_of(port)}: {reason(err)}; choose another port, or 0") from err
    listener.setblocking(False)
    return listener, listener.getsockname()[1]


class LatestClient:
    """A listener and the latest of its clients, to whom it sends without waiting."""

    def __init__(self, *, send_buffer_bytes: int | None = None) -> None:
        self.client: socket.socket | None = None
        self._listener: socket.socket | None = None
        self._port = 0
        self._send_buffer_bytes = send_buffer_bytes

    @property
    def address(self) -> str:
        """`tcp://HOST:PORT`, with the actual port after `open`."""
        return address_of(self._port)

    def open(self) -> None:
        """Listen; the second time at the same port."""
        self._listener, self._port = listen(self._port)

    def close(self) -> None:
        """Close the connection and the listener; safe to call twice."""
        self.drop()
        if self._listener is not None:
            self._listener.close()
        self._listener = None

    def accepts(self, timeout_s: float, *, reading: bool = False, writing: bool = False) -> bool:
        """Accept another client; False if none connects in time, or before the present one sends or takes bytes."""
        readers = [one for one in (self._listener, self.client if reading else None) if one]
        writers = [self.client] if self.client and writing else []
        ready, _, _ = select.select(readers, writers, [], timeout_s)
        if self._listener is None or self._listener not in ready:
            return False
        with contextlib.suppress(OSError):  # it is disconnected already
            client, _ = self._listener.accept()
            client.setblocking(False)
            if self._send_buffer_bytes is not None:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._send_buffer_bytes)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.drop()
            self.client = client
        return True

    def send(self, data: memoryview) -> int:
        """Return the number of bytes that the client accepted at once."""
        if self.client is None:
            return 0
        try:
            return self.client.send(data)
        except BlockingIOError:
            return 0
        except OSError:  # it disconnected
            self.drop()
            return 0

    def drop(self) -> None:
        """Close the connection to the client, if there is one."""
        if self.client is not None:
            self.client.close()
            self.client = None


_SLICE_S = 0.005  # line time of one slice of a paced reply
_BITS_PER_BYTE = 10  # start, eight data, stop


class Startable(Protocol):
    """A server from `start()` to `stop()`, or in a `with`."""

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
    """Serves one `Conversation` per connection, each on its own daemon thread.

    Parameters
    ----------
    converse
        Creates the conversation of a new connection.
    port
        Where to listen; 0 takes a free one, which `address` then contains.
    pace_baud
        Replies are sent no faster than over a serial line of this speed in bits per second (10 bits a byte, wall time).

    Attributes
    ----------
    faults
        The faults of requests on later connections; None: no faults.
    """

    def __init__(
        self,
        converse: Callable[[], Conversation],
        *,
        port: int = 0,
        pace_baud: int | None = None,
    ) -> None:
        self.faults: LinkFaults | None = None
        self._converse = converse
        self._port = port
        self._pace_baud = pace_baud
        self._listener: socket.socket | None = None
        self._acceptor: threading.Thread | None = None
        self._wake: socket.socket | None = None
        self._stopping = threading.Event()
        self._away_until_s = 0.0  # wall time until which it does not listen
        self._gone = threading.Event()
        self._lock = threading.Lock()
        self._connections: dict[socket.socket, threading.Thread] = {}

    @property
    def address(self) -> str:
        """`tcp://HOST:PORT`, with the actual port while it runs."""
        return address_of(self._port)

    def start(self) -> None:
        """Listen; when it returns, a client can connect."""
        if self._listener is not None:
            return
        listener, self._port = listen(self._port)
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
            with contextlib.suppress(OSError):  # during a simulated absence it has closed already
                self._wake.send(b"!")
            self._acceptor.join()
            self._wake.close()
        self._listener = self._acceptor = self._wake = None
        self.cut_connections()

    def cut_connections(self) -> None:
        """Close every present connection, as a pulled cable does, and continue to listen."""
        with self._lock:
            present = dict(self._connections)
        for connection, thread in present.items():
            with contextlib.suppress(OSError):  # it may have closed meanwhile
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
                listener, _ = listen(self._port)

    def _accept_until_woken(self, listener: socket.socket, awake: socket.socket) -> None:
        while True:
            ready, _, _ = select.select([listener, awake], [], [])
            if awake in ready:
                awake.recv(1)
                return
            with contextlib.suppress(OSError):  # a client that disconnected before it was accepted
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
            pass  # the client disconnected, or the connection was cut: both end it
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
        with contextlib.suppress(OSError):  # the server is being stopped
            self._wake.send(b"!")
        self._gone.wait(for_s)
        self.cut_connections()

    def _send(self, connection: socket.socket, reply: bytes) -> None:
        if self._pace_baud is None:
            connection.sendall(reply)
        else:
            self._send_paced(connection, reply, self._pace_baud)

    def _send_paced(self, connection: socket.socket, reply: bytes, baud: int) -> None:
        """Send a reply so that the last byte of a slice arrives when a line would have carried it."""
        size = max(1, int(baud * _SLICE_S / _BITS_PER_BYTE))
        started_s = time.monotonic()
        for first in range(0, len(reply), size):
            piece = reply[first : first + size]
            due_s = started_s + (first + len(piece)) * _BITS_PER_BYTE / baud
            if self._stopping.wait(max(0.0, due_s - time.monotonic())):
                return
            connection.sendall(piece)
