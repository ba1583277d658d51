"""A Modbus master over pymodbus: reads and writes registers, with one error policy and errors that name the unit.

An address `tcp://HOST:PORT` uses Modbus TCP; `serial://DEVICE?baud=N` and `socket://HOST:PORT` use Modbus RTU.

The subclasses of pymodbus' synchronous clients report why they cannot connect, log the traffic, and return an answer as
soon as it arrives. Each client is used for one connection, from `connect` to `close`: after a failure it is not used
again, so that no late bytes can be taken for the answer to a later request. `heard` holds the bytes received since the
last request.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import Lock, RLock
from weakref import WeakValueDictionary

import serial
from pymodbus import ModbusException
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import Clock
from benchctl_instruments.links.address import Address, parse_address, refuse_timeout
from benchctl_instruments.links.serial_port import connect_reason
from benchctl_instruments.links.wirelog import WireLog, note_recovered
from benchctl_instruments.protocols.modbus import (
    READ_HOLDING,
    WRITE_ONE,
    WRITE_SEVERAL,
    exception_words,
)

DEFAULT_BAUD = 19200
MOST_BYTES = 4096

# Every failure is raised as one of our errors; the library's own log line would repeat it.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


class TcpClient(ModbusTcpClient):
    """A Modbus TCP client."""

    def __init__(self, address: Address, timeout_s: float, wire_log: WireLog) -> None:
        super().__init__(address.host, port=address.port, timeout=timeout_s, retries=0)
        self._where = (address.host, address.port)
        self._timeout_s = timeout_s
        self.wire_log = wire_log
        self.heard = b""

    def connect(self) -> bool:
        """Connect unless connected; raises `OSError` with the reason on failure."""
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
        super().close()  # type: ignore[no-untyped-call]  # untyped in pymodbus

    def recv(self, size: int | None) -> bytes:
        """Return the received bytes, waiting for the first one; empty after the time-out."""
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
    """A Modbus RTU client on any port that pyserial opens.

    pymodbus polls a serial port every millisecond or more until the number of waiting bytes no longer grows. This
    client wakes on the first byte, and the frame's length and CRC determine its end: that is faster on a fast line, and
    a gap within a frame does no harm.
    """

    def __init__(self, address: Address, timeout_s: float, wire_log: WireLog) -> None:
        self._baud = address.baud or DEFAULT_BAUD
        super().__init__(address.pyserial_url, baudrate=self._baud, timeout=timeout_s, retries=0)
        self._url = address.pyserial_url
        self._timeout_s = timeout_s
        self.wire_log = wire_log
        self.heard = b""

    def connect(self) -> bool:
        """Open the port exclusively unless it is open; raises `OSError` or `ValueError` with the reason on failure."""
        if self.socket is None:
            self.socket = serial.serial_for_url(
                self._url, baudrate=self._baud, timeout=self._timeout_s, write_timeout=self._timeout_s, exclusive=True
            )
        return True

    def lend(self, timeout_s: float, wire_log: WireLog) -> None:
        """Serve another unit on the line, with the unit's time-out and log."""
        self.comm_params.timeout_connect = timeout_s
        if self.socket is not None:
            self.socket.timeout = timeout_s
        self.wire_log = wire_log

    def send(self, request: bytes, addr: tuple[str, int] | None = None) -> int:
        """Discard unread input and send a frame."""
        self.heard = b""
        self.wire_log.sent(request)
        return int(super().send(request, addr))

    def close(self) -> None:
        """Close the port."""
        super().close()  # type: ignore[no-untyped-call]  # untyped in pymodbus

    def recv(self, size: int | None) -> bytes:
        """Return the received bytes, waiting for the first one; empty after the time-out."""
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
    """Return a new, connected client; raises `OSError` or `ValueError` with the reason on failure."""
    client: ModbusClient = (TcpClient if address.scheme == "tcp" else RtuClient)(address, timeout_s, wire_log)
    client.connect()
    return client


class ModbusLine:
    """A connection shared by links; use it only while holding `lock`.

    Attributes
    ----------
    lock
        Lock of the line.
    client
        The present connection, or None.
    quiet_until_s
        Wall time until which nothing is sent after a failure, so that late answers are discarded.
    """

    def __init__(self) -> None:
        self.lock = RLock()
        self.client: ModbusClient | None = None
        self.quiet_until_s = 0.0
        self._users = 0
        self._baud = DEFAULT_BAUD

    def join(self, address: Address) -> None:
        """Register another link that uses the line.

        Raises
        ------
        UsageError
            If the line is used at another speed.
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
        """Unregister a link; the last one closes the line."""
        self._users -= 1
        if not self._users:
            self.drop(why)

    def connected(self, address: Address, timeout_s: float, wire_log: WireLog) -> ModbusClient:
        """Return the connection, a new one if there is none, with a link's own time-out and log."""
        if self.client is None:
            self.client = connected_client(address, timeout_s, wire_log)
            wire_log.note(f"connected to {address}")
        elif isinstance(self.client, RtuClient):
            self.client.lend(timeout_s, wire_log)
        return self.client

    def drop(self, why: str) -> None:
        """Close the connection; the next exchange makes a new one."""
        if self.client is not None:
            self.client.wire_log.note(why)
            with contextlib.suppress(OSError):  # an unplugged device cannot be closed cleanly
                self.client.close()
            self.client = None

    def be_quiet(self, seconds: float) -> None:
        """Send nothing for `seconds` of wall time from now on."""
        self.quiet_until_s = max(self.quiet_until_s, time.monotonic() + seconds)

    def wait_until_quiet(self) -> None:
        """Wait until sending is permitted again."""
        if (quiet_s := self.quiet_until_s - time.monotonic()) > 0:
            time.sleep(quiet_s)


def line_at(address: Address) -> ModbusLine:
    """Return the line of an address: the one shared by all links to a serial line, or a new one."""
    if address.scheme == "tcp":
        return ModbusLine()
    with _GUARD:
        line = _LINES.get(address.pyserial_url)
        if line is None:
            line = _LINES[address.pyserial_url] = ModbusLine()
        return line


_GUARD = Lock()
_LINES: WeakValueDictionary[str, ModbusLine] = WeakValueDictionary()


ADVICE = "check power, cable, speed and unit number"
BROKEN = (ModbusException, OSError, struct.error, IndexError)  # the last two: a frame shorter than its header states


@dataclass(frozen=True, slots=True, kw_only=True)
class Retry:
    """Retry policy if no answer or a broken one arrives: reconnect after `wait_s`, and repeat the request.

    Repeating is harmless because registers are written with values and not with changes; if it is not (a toggling key),
    the caller passes `once`. A refusal is an answer and is never repeated. `attempts` includes the first one and is at
    least 1; `wait_s` is wall time in which a late answer passes before it could be taken for the answer to the next
    request.
    """

    attempts: int = 3
    wait_s: float = 0.1


class ModbusLink:
    """One unit at the end of a Modbus connection; thread-safe, and usable together with links to other units.

    | fault                                               | handling                                                 |
    |-----------------------------------------------------|----------------------------------------------------------|
    | no answer, half of one, another unit's, a bad CRC,  | repeated on a new connection, as in `Retry`; then        |
    | junk before or in it, a register too few            | `LinkError`                                              |
    | junk behind an answer, an answer in pieces          | discarded; assembled                                     |
    | a late answer                                       | accepted for its request; the line then stays quiet      |
    |                                                     | until the answer to the repeated one must have arrived   |
    | a cut connection, a restart                         | reconnected, and the request repeated                    |
    | an exception                                        | `InstrumentError`, never repeated                        |

    Recovered faults are reported to `benchctl_instruments.links.wirelog`.

    Parameters
    ----------
    address
        `tcp://` for Modbus TCP, `serial://` or `socket://` for RTU.
    unit_id
        The unit's number, 1 to 247.
    name
        The name of the instrument in error messages.
    timeout_s
        Timeout of an answer and of a connection; wall time.
    retry
        The retry policy.
    pause_s, clock
        Quiet time between two exchanges, and the clock that measures it; by default the host's clock.
    wire_log
        Log of the traffic on the link.
    """

    def __init__(
        self,
        address: str,
        *,
        unit_id: int = 1,
        name: str = "instrument",
        timeout_s: float = 1.0,
        retry: Retry | None = None,
        pause_s: float = 0.0,
        clock: Clock | None = None,
        wire_log: WireLog | None = None,
    ) -> None:
        self.address = parse_address(address)
        if self.address.scheme in ("visa", "daqmx"):
            raise UsageError(
                f"address {address!r}: Modbus has no {self.address.scheme}; expected tcp, serial or socket"
            )
        self.wire_log = wire_log if wire_log is not None else WireLog()
        self.who = f"{name} at {self.address}, unit {unit_id}"
        self._unit_id = unit_id
        refuse_timeout(self.address, timeout_s)
        self._timeout_s = timeout_s
        self._retry = retry if retry is not None else Retry()
        self._pause_s = pause_s
        self._now: Callable[[], float] = time.monotonic if clock is None else clock.now
        self._sleep: Callable[[float], None] = time.sleep if clock is None else clock.sleep
        self._paused_until_s = 0.0  # by that clock
        self._line = line_at(self.address)
        self._opened = False

    def open(self) -> None:
        """Connect; the first read shows whether the unit answers."""
        with self._line.lock:
            self.close()
            self._line.join(self.address)
            try:
                self._line.connected(self.address, self._timeout_s, self.wire_log)
            except (OSError, ValueError) as err:
                self._line.leave("not connected")
                raise LinkError(
                    f"{self.who}: cannot connect: {connect_reason(err)}; check power, cable and address"
                ) from err
            self._opened = True

    def close(self) -> None:
        """Close the connection; safe to call twice, and never raises."""
        with self._line.lock:
            if self._opened:
                self._opened = False
                self._line.leave("closed")

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return `count` registers from `address` on (function 3)."""
        reply = self._exchange(
            f"reading {_registers(address, count)}",
            lambda client: client.read_holding_registers(address, count=count, device_id=self._unit_id),
            lambda reply: reply.function_code == READ_HOLDING and len(reply.registers) == count,
        )
        return list(reply.registers)

    def write(self, address: int, values: Sequence[int], *, several: bool = False, once: bool = False) -> None:
        """Write words from `address` on: one with function 6, several with function 16.

        `several` uses function 16 for one word too; with `once` the request is not repeated if no answer arrives.
        """
        words = list(values)
        what = f"writing {', '.join(map(str, words))} to {_registers(address, len(words))}"
        attempts = 1 if once else self._retry.attempts
        if len(words) == 1 and not several:
            self._exchange(
                what,
                lambda client: client.write_register(address, words[0], device_id=self._unit_id),
                lambda reply: (reply.function_code, reply.address, reply.registers) == (WRITE_ONE, address, words),
                attempts,
            )
        else:
            self._exchange(
                what,
                lambda client: client.write_registers(address, words, device_id=self._unit_id),
                lambda reply: (reply.function_code, reply.address, reply.count) == (WRITE_SEVERAL, address, len(words)),
                attempts,
            )

    def _exchange(
        self,
        what: str,
        ask: Callable[[ModbusClient], ModbusPDU],
        fits: Callable[[ModbusPDU], bool],
        attempts: int | None = None,
    ) -> ModbusPDU:
        """Request and, as the policy permits, repeat; `fits` returns whether an answer belongs to this request."""
        attempts = attempts if attempts is not None else self._retry.attempts
        with self._line.lock:
            if not self._opened:
                raise UsageError(f"{self.who}: {what} needs an open link; call open() first")
            reason = ""
            for attempt in range(1, attempts + 1):
                try:
                    reply = self._ask(ask, fits)
                    break
                except BROKEN as err:
                    reason = self._reason(err)
                    self._line.drop(reason)
                    self._line.be_quiet(self._retry.wait_s)
                    if attempt == attempts:
                        raise LinkError(
                            f"{self.who}: {what} came to nothing, tried {_times(attempts)}: {reason}; {ADVICE}"
                        ) from err
            if reason:
                note_recovered(f"{self.who}: {what} came to nothing: {reason}")
                self._let_spare_answer_pass()
        if isinstance(reply, ExceptionResponse):
            raise InstrumentError(
                f"{self.who}: {what} was refused with {exception_words(reply.exception_code)};"
                " check that it is the right model and the value within its limits"
            )
        return reply

    def _ask(self, ask: Callable[[ModbusClient], ModbusPDU], fits: Callable[[ModbusPDU], bool]) -> ModbusPDU:
        self._line.wait_until_quiet()
        if self._pause_s > 0 and (pause_s := self._paused_until_s - self._now()) > 0:
            self._sleep(pause_s)
        client = self._line.connected(self.address, self._timeout_s, self.wire_log)
        reply = ask(client)
        if self._pause_s > 0:
            self._paused_until_s = self._now() + self._pause_s
        if not isinstance(reply, ExceptionResponse) and not fits(reply):
            raise ModbusException("it belongs to another request")
        if self.address.scheme == "tcp" and len(client.heard) != _tcp_frame_bytes(client.heard):
            raise ModbusException("more came than the answer, so it may not be what was sent")  # there is no checksum
        return reply

    def _let_spare_answer_pass(self) -> None:
        """Drop late answers: the accepted answer may be that to the first request; a line cannot tell them apart."""
        if self.address.scheme != "tcp":
            self._line.drop("asked twice: a second answer may follow")
            self._line.be_quiet(self._timeout_s)

    def _reason(self, err: Exception) -> str:
        client = self._line.client
        if client is None:
            return f"cannot connect: {connect_reason(err)}"
        if client.heard:
            return f"the answer is broken or belongs to another request: {client.heard.hex(' ')}"
        if client.connected:
            return f"no answer within {self._timeout_s:g} s"
        return "the other side closed the connection"


def _tcp_frame_bytes(heard: bytes) -> int:
    """Return the length of a Modbus TCP frame: its header states how many bytes follow the first six."""
    return 6 + int.from_bytes(heard[4:6], "big")


def _registers(address: int, count: int) -> str:
    return f"register {address}" if count == 1 else f"registers {address} to {address + count - 1}"


def _times(attempts: int) -> str:
    return "once" if attempts == 1 else f"{attempts} times"
