"""A hundred plain registers, and devices that misbehave on the wire, for the tests of everything that speaks Modbus."""

from __future__ import annotations

from collections.abc import Callable

from benchctl_instruments.protocols.modbus import (
    ILLEGAL_ADDRESS,
    ModbusRefusal,
    Request,
    RtuFraming,
    ServerFraming,
    TcpFraming,
)


class Memory:
    """Registers 0 to 99, each holding its own number at first; counts the requests that reach it."""

    def __init__(self) -> None:
        self.words = list(range(100))
        self.writes: list[tuple[int, list[int]]] = []

    def read(self, address: int, count: int) -> list[int]:
        if address + count > len(self.words):
            raise ModbusRefusal(ILLEGAL_ADDRESS)
        return self.words[address : address + count]

    def write(self, address: int, values: list[int]) -> None:
        if address + len(values) > len(self.words):
            raise ModbusRefusal(ILLEGAL_ADDRESS)
        self.writes.append((address, values))
        self.words[address : address + len(values)] = values


class Misbehaving:
    """Answers reads like `Memory`, but each answer first goes through `spoil`, which knows how many there were before.

    A device for a whole test: every connection continues with the same count.
    """

    def __init__(self, spoil: Callable[[int, bytes], bytes], *, over_tcp: bool = False) -> None:
        self._spoil = spoil
        self._over_tcp = over_tcp
        self.asked: list[Request] = []

    def connect(self) -> MisbehavingConversation:
        framing: ServerFraming = TcpFraming() if self._over_tcp else RtuFraming()
        return MisbehavingConversation(self, framing)

    def answer(self, framing: ServerFraming, request: Request) -> bytes:
        self.asked.append(request)
        words = range(request.address, request.address + request.count)
        return self._spoil(len(self.asked) - 1, framing.reply(request, list(words) if request.function == 3 else ()))


class MisbehavingConversation:
    """One connection to a `Misbehaving` device."""

    def __init__(self, device: Misbehaving, framing: ServerFraming) -> None:
        self._device = device
        self._framing = framing

    def feed(self, data: bytes) -> bytes:
        return b"".join(self._device.answer(self._framing, request) for request in self._framing.feed(data))
