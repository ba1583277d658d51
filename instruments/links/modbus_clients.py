"""pymodbus' synchronous clients that tell why they cannot connect, show what goes over the wire, and answer at once.

Each lasts for one connection, from `connect` to `close`: a client that has failed is not used again, so that nothing
which arrives late can be taken for the answer to a later request. `heard` is what has come since the last request.
"""

from __future__ import annotations

import logging
import socket

import serial
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException

from benchctl_instruments.links.address import Address
from benchctl_instruments.links.wirelog import WireLog

DEFAULT_BAUD = 19200
MOST_BYTES = 4096

# Whatever goes wrong is raised as one of our errors; the library's own log line would say it a second time.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


class TcpClient(ModbusTcpClient):
    """Modbus TCP."""

    def __init__(self, address: Address, timeout_s: float, wire_log: WireLog) -> None:
        super().__init__(address.host, port=address.port, timeout=timeout_s, retries=0)
        self._where = (address.host, address.port)
        self._timeout_s = timeout_s
        self.wire_log = wire_log
        self.heard = b""

    def connect(self) -> bool:
        """Connect, where that is not yet done; `OSError` says why it cannot be."""
        if self.socket is None:
            self.socket = socket.create_connection(self._where, timeout=self._timeout_s)
            self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return True

    def send(self, request: bytes, addr: tuple[str, int] | None = None) -> int:
        """Send a frame."""
        self.heard = b""
        self.wire_log.sent(request)
        return int(super().send(request, addr))

    def close(self) -> None:
        """Close the connection."""
        super().close()  # type: ignore[no-untyped-call]  # pymodbus leaves it untyped

    def recv(self, size: int | None) -> bytes:
        """The bytes that have come, waiting for the first; none after the time-out."""
        if self.socket is None:
            raise ConnectionException("the connection is closed")
        try:
            data = bytes(self.socket.recv(MOST_BYTES))
        except TimeoutError:
            return b""
        except OSError as err:
            self.close()
            raise ConnectionException(str(err)) from err
        if not data:
            self.close()
            raise ConnectionException("the other side closed the connection")
        self.heard += data
        self.wire_log.received(data)
        return data


class RtuClient(ModbusSerialClient):
    """Modbus RTU on whatever pyserial opens.

    pymodbus polls a serial port every millisecond or more until the number of waiting bytes no longer grows. Here the
    first byte wakes the reader, and the frame's own length and CRC say when it is whole: that takes less time on a fast
    line, and a gap within a frame does no harm.
    """

    def __init__(self, address: Address, timeout_s: float, wire_log: WireLog) -> None:
        self._baud = address.baud or DEFAULT_BAUD
        super().__init__(address.pyserial_url, baudrate=self._baud, timeout=timeout_s, retries=0)
        self._url = address.pyserial_url
        self._timeout_s = timeout_s
        self.wire_log = wire_log
        self.heard = b""

    def connect(self) -> bool:
        """Open the port for us alone, where that is not yet done; `OSError` or `ValueError` says why it cannot be."""
        if self.socket is None:
            self.socket = serial.serial_for_url(
                self._url, baudrate=self._baud, timeout=self._timeout_s, write_timeout=self._timeout_s, exclusive=True
            )
        return True

    def lend(self, timeout_s: float, wire_log: WireLog) -> None:
        """Serve another unit on the line: with its time-out and its log."""
        self.comm_params.timeout_connect = timeout_s
        if self.socket is not None:
            self.socket.timeout = timeout_s
        self.wire_log = wire_log

    def send(self, request: bytes, addr: tuple[str, int] | None = None) -> int:
        """Send a frame, after throwing away what nobody asked for."""
        self.heard = b""
        self.wire_log.sent(request)
        return int(super().send(request, addr))

    def close(self) -> None:
        """Close the port."""
        super().close()  # type: ignore[no-untyped-call]  # pymodbus leaves it untyped

    def recv(self, size: int | None) -> bytes:
        """The bytes that have come, waiting for the first; none after the time-out."""
        if self.socket is None:
            raise ConnectionException("the port is closed")
        try:
            data = bytes(self.socket.read(1))
            data += self.socket.read(min(self.socket.in_waiting, MOST_BYTES)) if data else b""
        except OSError as err:
            raise ConnectionException(str(err)) from err
        self.heard += data
        self.wire_log.received(data)
        return data


ModbusClient = TcpClient | RtuClient


def connected_client(address: Address, timeout_s: float, wire_log: WireLog) -> ModbusClient:
    """A new client, connected; `OSError` or `ValueError` says why it cannot be."""
    client: ModbusClient = (TcpClient if address.scheme == "tcp" else RtuClient)(address, timeout_s, wire_log)
    client.connect()
    return client
