"""Any link that carries bytes: a TCP connection, a serial port, or a serial line at the far end of a TCP connection."""

from __future__ import annotations

from typing import Protocol

from benchctl_instruments.links.address import Address, parse_address
from benchctl_instruments.links.serial_port import DEFAULT_BAUD, SerialLink
from benchctl_instruments.links.tcp import Reconnect, TcpLink
from benchctl_instruments.links.wirelog import WireLog


class ByteLink(Protocol):
    """What a driver needs of a link; an exchange that fails raises `LinkError`, a cut one `LinkCutError`."""

    address: Address
    wire_log: WireLog

    def open(self, timeout_s: float) -> None:
        """Connect; each attempt, now and later, may take `timeout_s` of wall time."""

    def close(self) -> None:
        """Let go of the connection; safe to call twice, and never raises."""

    def cut(self, why: str) -> None:
        """Give up the connection but stay open: the next `send` makes a new one."""

    def send(self, data: bytes) -> None:
        """Send all of it; what had arrived before is thrown away."""

    def receive(self, max_bytes: int, timeout_s: float) -> bytes:
        """The next bytes, at least one, within `timeout_s` of wall time."""


def byte_link(
    address: str,
    *,
    default_baud: int = DEFAULT_BAUD,
    reconnect: Reconnect | None = None,
    wire_log: WireLog | None = None,
) -> ByteLink:
    """The link for an address: `tcp://`, `socket://` (serial behind a TCP box), or `serial://`."""
    if parse_address(address).scheme == "serial":
        return SerialLink(address, default_baud=default_baud, wire_log=wire_log)
    return TcpLink(address, reconnect=reconnect, wire_log=wire_log)
