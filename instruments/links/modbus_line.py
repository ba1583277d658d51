"""A Modbus connection and the units at its end: a serial line has one owner in this process, whoever talks on it.

Links to several units on one line share its port and take turns. Where one unit does not answer, its link may open the
port anew; the others notice nothing but that they wait for their turn.
"""

from __future__ import annotations

import contextlib
import time
from threading import Lock, RLock
from weakref import WeakValueDictionary

from benchctl_instruments.errors import UsageError
from benchctl_instruments.links.address import Address
from benchctl_instruments.links.modbus_clients import DEFAULT_BAUD, ModbusClient, RtuClient, connected_client
from benchctl_instruments.links.wirelog import WireLog


class ModbusLine:
    """One connection, while links use it; everything is done under `lock`.

    Attributes
    ----------
    lock
        Who holds it has the line.
    client
        The present connection; None: none.
    quiet_until_s
        Wall time before which nothing is said, after a failure: what arrives late is nobody's answer.
    """

    def __init__(self) -> None:
        self.lock = RLock()
        self.client: ModbusClient | None = None
        self.quiet_until_s = 0.0
        self._users = 0
        self._baud = DEFAULT_BAUD

    def join(self, address: Address) -> None:
        """One link more uses the line.

        Raises
        ------
        UsageError
            Where those who use it talk at another speed.
        """
        baud = address.baud or DEFAULT_BAUD
        if self._users and baud != self._baud:
            raise UsageError(
                f"address {str(address)!r}: {baud} baud, but another unit on this line talks at {self._baud};"
                " give all units of a line the same speed"
            )
        self._baud = baud
        self._users += 1

    def leave(self, why: str) -> None:
        """One link less uses the line; the last one closes it."""
        self._users -= 1
        if not self._users:
            self.drop(why)

    def connected(self, address: Address, timeout_s: float, wire_log: WireLog) -> ModbusClient:
        """The connection, new where there is none, with a link's own time-out and log."""
        if self.client is None:
            self.client = connected_client(address, timeout_s, wire_log)
            wire_log.note(f"connected to {address}")
        elif isinstance(self.client, RtuClient):
            self.client.lend(timeout_s, wire_log)
        return self.client

    def drop(self, why: str) -> None:
        """Give up the connection; the next exchange makes a new one."""
        if self.client is not None:
            self.client.wire_log.note(why)
            with contextlib.suppress(OSError):  # a device that was pulled out cannot be closed in good order
                self.client.close()
            self.client = None

    def be_quiet(self, seconds: float) -> None:
        """Say nothing for so much wall time from now on."""
        self.quiet_until_s = max(self.quiet_until_s, time.monotonic() + seconds)

    def wait_until_quiet(self) -> None:
        """Wait until something may be said again."""
        if (quiet_s := self.quiet_until_s - time.monotonic()) > 0:
            time.sleep(quiet_s)


def line_at(address: Address) -> ModbusLine:
    """The line of an address: that of the other links to the same serial line, or one of its own."""
    if address.scheme == "tcp":
        return ModbusLine()
    with _GUARD:
        line = _LINES.get(address.pyserial_url)
        if line is None:
            line = _LINES[address.pyserial_url] = ModbusLine()
        return line


_GUARD = Lock()
_LINES: WeakValueDictionary[str, ModbusLine] = WeakValueDictionary()
