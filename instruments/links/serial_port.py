"""A link over a serial port of this machine, for protocols with their own framing.

The policy is that of `links.tcp`: nothing is ever sent twice, and failures raise errors. The next `send` reopens a port
that was unplugged.

A `ByteLink` is any link that carries bytes: a TCP connection, a serial port, or a serial line at the far end of a TCP
connection.
"""

from __future__ import annotations

import contextlib
import errno
import os
from typing import Protocol

import serial

from benchctl_instruments.errors import LinkError, UsageError, in_line, reason
from benchctl_instruments.links.address import Address, parse_address, refuse_timeout
from benchctl_instruments.links.tcp import LinkCutError, Reconnect, TcpLink
from benchctl_instruments.links.visa import VisaLink
from benchctl_instruments.links.wirelog import WireLog

DEFAULT_BAUD = 19200


class SerialLink:
    """One serial port at a `serial://DEVICE?baud=N` address, 8N1, opened exclusively. Not thread-safe.

    Every `LinkError` names the address and the attempted action.
    """

    def __init__(self, address: str, *, default_baud: int = DEFAULT_BAUD, wire_log: WireLog | None = None) -> None:
        self.address = parse_address(address)
        if self.address.scheme != "serial":
            raise UsageError(f"address {address!r}: expected a serial port, serial://DEVICE?baud=N")
        self.wire_log = wire_log if wire_log is not None else WireLog()
        self._baud = self.address.baud or default_baud
        self._port: serial.Serial | None = None
        self._timeout_s: float | None = None  # None: not open

    def open(self, timeout_s: float) -> None:
        """Open the port; `timeout_s` is the timeout, in wall time, of all writes."""
        refuse_timeout(self.address, timeout_s)
        self.close()
        self._timeout_s = timeout_s
        try:
            self._connect()
        except LinkError:
            self._timeout_s = None
            raise

    def close(self) -> None:
        """Close the port; safe to call twice, and never raises."""
        self._timeout_s = None
        self._drop("closed")

    def cut(self, why: str) -> None:
        """Close the port but stay open: the next `send` reopens it and discards input received meanwhile."""
        self._drop(why)

    def send(self, data: bytes) -> None:
        """Discard unread input and send all data."""
        port = self._port if self._port is not None else self._connect()
        try:
            if stale := port.read(port.in_waiting):
                self.wire_log.received(stale)
                self.wire_log.note("discarded: not requested")
            self.wire_log.sent(data)
            port.write(data)
        except OSError as err:  # includes pyserial's own exceptions
            self._drop(f"cut while sending: {err}")
            raise LinkCutError(f"{self.address}: could not send {data[:64]!r}: {err}; check the cable") from err

    def receive(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return the next bytes, at least one, within `timeout_s` of wall time."""
        if self._port is None:
            raise LinkCutError(f"{self.address}: the port was given up, nothing can be received; send something first")
        timeout_s = max(timeout_s, 1e-3)
        try:
            self._port.timeout = timeout_s
            data = bytes(self._port.read(1))
            if data:
                data += self._port.read(min(self._port.in_waiting, max_bytes - 1))
        except OSError as err:
            self._drop(f"cut while receiving: {err}")
            raise LinkCutError(f"{self.address}: the line broke while receiving: {err}; check the cable") from err
        if not data:
            raise LinkError(f"{self.address}: nothing came within {timeout_s:.3g} s")
        self.wire_log.received(data)
        return data

    def _connect(self) -> serial.Serial:
        if self._timeout_s is None:
            raise UsageError(f"{self.address}: the link is not open; call open() first")
        try:
            self._port = serial.Serial(
                self.address.device, baudrate=self._baud, write_timeout=self._timeout_s, exclusive=True
            )
        except (OSError, ValueError) as err:
            raise LinkError(
                f"{self.address}: cannot be opened: {connect_reason(err)}; check that the device is plugged in, that "
                "you may use it, and that no other program does"
            ) from err
        self.wire_log.note(f"opened {self.address}")
        return self._port

    def _drop(self, why: str) -> None:
        if self._port is None:
            return
        self.wire_log.note(why)
        port, self._port = self._port, None
        with contextlib.suppress(OSError):  # an unplugged device cannot be closed cleanly
            port.close()


def connect_reason(err: Exception) -> str:
    """Return the system's reason of a failed connection; pyserial's message repeats the port and the error number."""
    if isinstance(err, serial.SerialException) and err.errno:
        return "another program has it open" if err.errno == errno.EAGAIN else in_line(os.strerror(err.errno))
    return reason(err) if isinstance(err, OSError) else in_line(str(err))


class ByteLink(Protocol):
    """The link that a driver uses; a failed exchange raises `LinkError`, a cut one `LinkCutError`."""

    address: Address
    wire_log: WireLog

    def open(self, timeout_s: float) -> None:
        """Connect; `timeout_s` is the timeout, in wall time, of every connection attempt."""

    def close(self) -> None:
        """Close the connection; safe to call twice, and never raises."""

    def cut(self, why: str) -> None:
        """Close the connection but stay open: the next `send` makes a new one."""

    def send(self, data: bytes) -> None:
        """Discard unread input and send all data."""

    def receive(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return the next bytes, at least one, within `timeout_s` of wall time."""


def byte_link(
    address: str,
    *,
    default_baud: int = DEFAULT_BAUD,
    reconnect: Reconnect | None = None,
    wire_log: WireLog | None = None,
) -> ByteLink:
    """Return the link for an address: `tcp://`, `socket://` (serial behind a TCP box), `serial://` or `visa://`."""
    match parse_address(address).scheme:
        case "serial":
            return SerialLink(address, default_baud=default_baud, wire_log=wire_log)
        case "visa":
            return VisaLink(address, wire_log=wire_log)
        case _:
            return TcpLink(address, reconnect=reconnect, wire_log=wire_log)
