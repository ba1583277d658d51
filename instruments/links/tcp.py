"""A link over TCP, for protocols with their own framing.

The reconnect policy: an exchange during which the link is cut fails with `LinkCutError`, and nothing is ever sent
twice, because only a driver can decide whether repeating a request is harmless. The next `send` reconnects, in at most
`Reconnect.attempts` attempts, `Reconnect.wait_s` apart. A link that was cut while idle is detected before anything is
sent, so that such a cut has no effect.
"""

from __future__ import annotations

import contextlib
import socket
import time
from dataclasses import dataclass

from benchctl_instruments.errors import LinkError, UsageError, reason
from benchctl_instruments.links.address import parse_address, refuse_timeout
from benchctl_instruments.links.wirelog import WireLog


class LinkCutError(LinkError):
    """The connection broke during an exchange; whether the request arrived is unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reconnect:
    """Number of connection attempts (at least 1) and the wall time [s] between two of them."""

    attempts: int = 3
    wait_s: float = 0.2


class TcpLink:
    """One TCP connection to `tcp://` or `socket://HOST:PORT`, without Nagle's delay. Not thread-safe.

    Every `LinkError` names the address and the attempted action.
    """

    def __init__(self, address: str, *, reconnect: Reconnect | None = None, wire_log: WireLog | None = None) -> None:
        self.address = parse_address(address)
        if self.address.scheme not in ("tcp", "socket"):
            raise UsageError(f"address {address!r}: expected tcp://HOST:PORT for this instrument")
        self.wire_log = wire_log if wire_log is not None else WireLog()
        self._reconnect = reconnect if reconnect is not None else Reconnect()
        self._socket: socket.socket | None = None
        self._connect_timeout_s: float | None = None  # None: not open

    def open(self, timeout_s: float) -> None:
        """Connect; `timeout_s` is the timeout, in wall time, of every connection attempt."""
        refuse_timeout(self.address, timeout_s)
        self.close()
        self._connect_timeout_s = timeout_s
        try:
            self._connect()
        except LinkError:
            self._connect_timeout_s = None
            raise

    def close(self) -> None:
        """Close the connection; safe to call twice, and never raises."""
        self._connect_timeout_s = None
        self._drop("closed")

    def cut(self, why: str) -> None:
        """Close the connection but stay open: the next `send` makes a new one, on which no late reply can arrive."""
        self._drop(why)

    def send(self, data: bytes) -> None:
        """Discard unread input and send all data on a live connection."""
        self._discard_input()
        connection = self._socket if self._socket is not None else self._connect()
        self.wire_log.sent(data)
        try:
            connection.sendall(data)
        except OSError as err:
            self._drop(f"cut while sending: {_reason(err)}")
            raise LinkCutError(
                f"{self.address}: could not send {data[:64]!r}: {_reason(err)}; check the cable"
            ) from err

    def receive(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return the next bytes, at least one, within `timeout_s` of wall time."""
        if self._socket is None:
            raise LinkCutError(f"{self.address}: the connection was cut, nothing can be received; send something first")
        timeout_s = max(timeout_s, 1e-3)  # available data are always read; 0 would mean not to wait at all
        self._socket.settimeout(timeout_s)
        try:
            data = self._socket.recv(max_bytes)
        except TimeoutError as err:
            raise LinkError(f"{self.address}: nothing came within {timeout_s:.3g} s") from err
        except OSError as err:
            self._drop(f"cut while receiving: {_reason(err)}")
            raise LinkCutError(
                f"{self.address}: the connection broke while receiving: {_reason(err)}; check the cable"
            ) from err
        if not data:
            self._drop("closed by the other side")
            raise LinkCutError(f"{self.address}: the other side closed the connection; look whether it is on")
        self.wire_log.received(data)
        return data

    def _connect(self) -> socket.socket:
        if self._connect_timeout_s is None:
            raise UsageError(f"{self.address}: the link is not open; call open() first")
        failure: OSError | None = None
        for attempt in range(self._reconnect.attempts):
            if attempt:
                time.sleep(self._reconnect.wait_s)
            try:
                return self._connect_once(self._connect_timeout_s)
            except OSError as err:
                failure = err
                self.wire_log.note(f"no connection: {_reason(err)}")
        attempts = self._reconnect.attempts
        raise LinkError(
            f"{self.address}: could not connect in {attempts} attempt{'s' * (attempts > 1)}: {_reason(failure)};"
            " check that the instrument is switched on, the cable, and host and port"
        ) from failure

    def _connect_once(self, timeout_s: float) -> socket.socket:
        connection = socket.create_connection((self.address.host, self.address.port), timeout=timeout_s)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = connection
        self.wire_log.note(f"connected to {self.address}")
        return connection

    def _discard_input(self) -> None:
        while self._socket is not None:
            self._socket.settimeout(0)
            try:
                stale = self._socket.recv(4096)
            except BlockingIOError:
                self._socket.settimeout(self._connect_timeout_s)
                return
            except OSError as err:
                self._drop(f"found cut: {_reason(err)}")
                return
            if not stale:
                self._drop("found closed by the other side")
                return
            self.wire_log.received(stale)
            self.wire_log.note("discarded: not requested")

    def _drop(self, why: str) -> None:
        if self._socket is None:
            return
        self.wire_log.note(why)
        connection, self._socket = self._socket, None
        with contextlib.suppress(OSError):  # a connection that is already broken cannot be shut down cleanly
            connection.shutdown(socket.SHUT_RDWR)
        connection.close()


def _reason(err: OSError | None) -> str:
    if isinstance(err, TimeoutError):
        return "no answer in time"
    return reason(err) if err is not None else "no attempt was allowed"
