"""Registers of simulated Modbus devices, and servers over them: TCP for any number of clients, RTU on a line.

pymodbus' server is not used: it answers for missing units and only the first of several pipelined requests, so a
client's time-outs and queues could not be tested with it.

Registers are a table of quantities with getters and setters, and plain memory. A quantity takes one register or, as a
32-bit number, two. A read may begin and end anywhere within declared registers, also in the middle of a number; a write
must contain complete quantities, because half of a number has no meaning. Everything else is refused before anything
is changed.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Protocol

from benchctl_instruments.protocols.modbus import (
    ILLEGAL_ADDRESS,
    ILLEGAL_VALUE,
    READS,
    ModbusRefusal,
    Request,
    RtuFraming,
    ServerFraming,
    TcpFraming,
    WordOrder,
    f32_from_words,
    signed_from_word,
    u32_from_words,
    words_from_f32,
    words_from_u32,
)
from benchctl_instruments.simulated.faults.wires import MODBUS_RTU, MODBUS_TCP, Wire
from benchctl_instruments.simulated.serial_line import SerialLine
from benchctl_instruments.simulated.tcp_server import TcpServer


class RegisterMap(Protocol):
    """Registers by number; both methods raise `ModbusRefusal` where the device answers with an exception."""

    def read(self, address: int, count: int) -> list[int]:
        """Return `count` words from `address` on."""

    def write(self, address: int, values: list[int]) -> None:
        """Write words from `address` on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Register:
    """A quantity: its first register, number of registers, and functions for its words; read-only without `write`."""

    address: int
    words: int
    read: Callable[[], list[int]]
    write: Callable[[list[int]], None] | None = None


class RegisterTable:
    """A `RegisterMap` of declared quantities.

    Parameters
    ----------
    registers
        The quantities; raises `ValueError` if two of them use the same register.
    memory
        Words by address that store written values and have no other effect.
    read_only_refusal
        The device's exception code for a write to a read-only register.
    """

    def __init__(
        self,
        registers: Iterable[Register],
        *,
        memory: dict[int, int] | None = None,
        read_only_refusal: int = ILLEGAL_ADDRESS,
    ) -> None:
        self._read_only_refusal = read_only_refusal
        self._memory = {} if memory is None else memory
        self._at: dict[int, Register] = {}
        for register in registers:
            for address in range(register.address, register.address + register.words):
                if address in self._at or address in self._memory:
                    raise ValueError(f"register {address} is declared twice")
                self._at[address] = register

    def read(self, address: int, count: int) -> list[int]:
        """Return `count` words from `address` on; each quantity is read once, so its words are consistent."""
        words: list[int] = []
        while len(words) < count:
            register = self._quantity(address + len(words))
            skipped = address + len(words) - register.address
            words += register.read()[skipped:]
        return words[:count]

    def write(self, address: int, values: list[int]) -> None:
        """Write complete quantities from `address` on, in order; if a setter refuses, the earlier ones stay written."""
        writes = []
        place = 0
        while place < len(values):
            register = self._quantity(address + place)
            if register.address != address + place or place + register.words > len(values):
                raise ModbusRefusal(ILLEGAL_ADDRESS)
            if register.write is None:
                raise ModbusRefusal(self._read_only_refusal)
            writes.append((register.write, values[place : place + register.words]))
            place += register.words
        for write, words in writes:
            write(words)

    def _quantity(self, address: int) -> Register:
        if address in self._memory:
            return word(address, lambda: self._memory[address], lambda value: self._memory.update({address: value}))
        if address not in self._at:
            raise ModbusRefusal(ILLEGAL_ADDRESS)
        return self._at[address]


class TakesSetpoint(Protocol):
    """A chamber whose set point can be set."""

    def set_setpoint(self, setpoint_c: float) -> None:
        """Set a new set point."""


class LimitedSetpoint:
    """A set point in °C between two limits; a value that violates their order is refused with exception 3."""

    def __init__(self, chamber: TakesSetpoint, low_c: float, high_c: float) -> None:
        self._chamber = chamber
        self.low_c, self.high_c = low_c, high_c

    def put(self, value_c: float) -> None:
        """Set a new set point."""
        if not self.low_c <= value_c <= self.high_c:  # also refuses NaN
            raise ModbusRefusal(ILLEGAL_VALUE)
        self._chamber.set_setpoint(value_c)

    def put_low(self, value_c: float) -> None:
        """Set a new low limit."""
        if not float("-inf") < value_c < self.high_c:
            raise ModbusRefusal(ILLEGAL_VALUE)
        self.low_c = value_c

    def put_high(self, value_c: float) -> None:
        """Set a new high limit."""
        if not self.low_c < value_c < float("inf"):
            raise ModbusRefusal(ILLEGAL_VALUE)
        self.high_c = value_c


def laid_out(runs: Mapping[int, Sequence[int]]) -> dict[int, int]:
    """Return words by address, from runs of words by first address."""
    return {first + place: value for first, words in runs.items() for place, value in enumerate(words)}


def constants(words: Mapping[int, int]) -> list[Register]:
    """Return read-only registers for constant words by address."""
    return [word(address, lambda value=value: value) for address, value in words.items()]  # type: ignore[misc]


def word(
    address: int,
    get: Callable[[], int],
    put: Callable[[int], object] | None = None,
    *,
    takes: Container[int] = range(0x10000),
) -> Register:
    """Return a register for an unsigned 16-bit number; values not in `takes` are refused with exception 3."""

    def write(words: list[int]) -> None:
        if words[0] not in takes:
            raise ModbusRefusal(ILLEGAL_VALUE)
        if put is not None:
            put(words[0])

    return Register(address=address, words=1, read=lambda: [get() & 0xFFFF], write=None if put is None else write)


def signed_word(address: int, get: Callable[[], int], put: Callable[[int], None] | None = None) -> Register:
    """Return a register for a 16-bit number in two's complement."""
    return word(address, get, None if put is None else lambda value: put(signed_from_word(value)))


def scaled(
    address: int, get: Callable[[], float], put: Callable[[float], None] | None = None, *, decimals: int
) -> Register:
    """Return a register for a signed number with an implied decimal point; values out of range are clipped."""
    step = 10**decimals
    return signed_word(
        address,
        lambda: round(max(-0x8000, min(0x7FFF, get() * step))),
        None if put is None else lambda value: put(value / step),
    )


def u32(address: int, get: Callable[[], int], put: Callable[[int], None] | None = None) -> Register:
    """Return two registers for an unsigned 32-bit number, high word first."""
    return Register(
        address=address,
        words=2,
        read=lambda: words_from_u32(get() & 0xFFFFFFFF, "high_first"),
        write=None if put is None else lambda words: put(u32_from_words(words, "high_first")),
    )


def f32(
    address: int,
    get: Callable[[], float],
    put: Callable[[float], None] | None = None,
    *,
    word_order: WordOrder = "high_first",
) -> Register:
    """Return two registers for an IEEE 754 single."""
    return Register(
        address=address,
        words=2,
        read=lambda: words_from_f32(get(), word_order),
        write=None if put is None else lambda words: put(f32_from_words(words, word_order)),
    )


BROADCAST = 0


class ModbusSession:
    """One connection: bytes in, bytes out. Requests for other units are not answered, as on a shared line.

    Parameters
    ----------
    framing
        TCP or RTU, a new one for each connection.
    registers
        The unit's registers; used under `lock`, so that requests are executed one at a time.
    unit_id
        The unit; None answers requests for any unit, as devices with their own network socket do.
    broadcasts
        Whether unit 0 addresses every unit: writes are then executed and not answered.
    ignores
        The writes that the unit acknowledges and does not execute.
    functions
        The unit's own functions by code, from the data of a request to the data of its reply.
    """

    def __init__(
        self,
        framing: ServerFraming,
        registers: RegisterMap,
        *,
        unit_id: int | None,
        lock: Lock,
        broadcasts: bool = False,
        ignores: Callable[[Request], bool] = lambda _: False,
        functions: Mapping[int, Callable[[bytes], bytes]] | None = None,
    ) -> None:
        self._functions = functions or {}
        self._framing = framing
        self._registers = registers
        self._unit_id = unit_id
        self._lock = lock
        self._broadcasts = broadcasts
        self._ignores = ignores

    def feed(self, data: bytes) -> bytes:
        """Add received bytes and return the replies to complete requests, in order."""
        return b"".join(self._answer(request) for request in self._framing.feed(data))

    def _answer(self, request: Request) -> bytes:
        if self._broadcasts and request.unit == BROADCAST:
            if request.function not in READS:
                self._carry_out(request)
            return b""
        if self._unit_id not in (None, request.unit):
            return b""
        return self._carry_out(request)

    def _carry_out(self, request: Request) -> bytes:
        own = self._functions.get(request.function)
        if request.fault and own is None:
            return self._framing.refuse(request, request.fault)
        try:
            with self._lock:
                if own is not None:
                    return self._framing.reply(request, own(request.data))
                if request.function in READS:
                    return self._framing.reply(request, self._registers.read(request.address, request.count))
                if not self._ignores(request):
                    self._registers.write(request.address, list(request.values))
        except ModbusRefusal as refusal:
            return self._framing.refuse(request, refusal.code)
        return self._framing.reply(request)


class ModbusTcpServer(TcpServer):
    """Modbus TCP at `address` ("tcp://127.0.0.1:PORT"), from `start()` to `stop()`, or in a `with`.

    Parameters
    ----------
    registers
        The registers.
    unit_id
        The unit that answers; None: any unit.
    pace_baud
        Simulated speed of the line; None: no delay.
    functions
        See `ModbusSession`.
    """

    wire: Wire = MODBUS_TCP

    def __init__(
        self,
        registers: RegisterMap,
        *,
        unit_id: int | None,
        pace_baud: int | None = None,
        functions: Mapping[int, Callable[[bytes], bytes]] | None = None,
    ) -> None:
        lock = Lock()
        super().__init__(
            lambda: ModbusSession(TcpFraming(), registers, unit_id=unit_id, lock=lock, functions=functions),
            pace_baud=pace_baud,
        )


class ModbusRtuServer(SerialLine):
    """Modbus RTU on a simulated serial line; see `SerialLine` for its address and common parameters.

    Parameters
    ----------
    registers
        The registers.
    unit_id
        The unit that answers; requests to unit 0 are executed and not answered.
    ignores
        See `ModbusSession`.
    """

    wire: Wire = MODBUS_RTU

    def __init__(
        self,
        registers: RegisterMap,
        *,
        unit_id: int,
        baud: int = 19200,
        pace_baud: int | None = None,
        over_tcp: bool = False,
        ignores: Callable[[Request], bool] = lambda _: False,
    ) -> None:
        lock = Lock()
        super().__init__(
            lambda: ModbusSession(
                RtuFraming(), registers, unit_id=unit_id, lock=lock, broadcasts=True, ignores=ignores
            ),
            baud=baud,
            pace_baud=pace_baud,
            over_tcp=over_tcp,
        )
