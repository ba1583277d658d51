"""What a simulated Modbus device keeps behind its registers: a declared table of quantities with getters and setters.

A quantity takes one register or, as a 32-bit number, two. A read may begin and end anywhere among declared registers,
also in the middle of a number; a write must bring whole quantities, because half of a number means nothing. Everything
else is refused before anything is changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from instruments.protocols.modbus import ILLEGAL_ADDRESS, ModbusRefusal
from instruments.protocols.words import (
    WordOrder,
    f32_from_words,
    signed_from_word,
    u32_from_words,
    words_from_f32,
    words_from_u32,
)


class RegisterMap(Protocol):
    """Registers by number; both methods raise `ModbusRefusal` for what the device answers with an exception."""

    def read(self, address: int, count: int) -> list[int]:
        """`count` words from `address` on."""

    def write(self, address: int, values: list[int]) -> None:
        """Write words from `address` on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Register:
    """A quantity: its first register, how many it takes, its words from and to the device; no `write`: read only."""

    address: int
    words: int
    read: Callable[[], list[int]]
    write: Callable[[list[int]], None] | None = None


class RegisterTable:
    """A `RegisterMap` of declared quantities.

    Parameters
    ----------
    registers
        The quantities; `ValueError` where two of them claim the same register.
    read_only_refusal
        The exception code that the device answers to a write to what is read only.
    """

    def __init__(self, registers: Iterable[Register], *, read_only_refusal: int = ILLEGAL_ADDRESS) -> None:
        self._read_only_refusal = read_only_refusal
        self._at: dict[int, Register] = {}
        for register in registers:
            for address in range(register.address, register.address + register.words):
                if address in self._at:
                    raise ValueError(f"register {address} is declared twice")
                self._at[address] = register

    def read(self, address: int, count: int) -> list[int]:
        """`count` words from `address` on; each quantity is asked once, so its words belong together."""
        words: list[int] = []
        while len(words) < count:
            register = self._quantity(address + len(words))
            skipped = address + len(words) - register.address
            words += register.read()[skipped:]
        return words[:count]

    def write(self, address: int, values: list[int]) -> None:
        """Write whole quantities from `address` on, in order; a setter that refuses leaves those before it written."""
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
        if address not in self._at:
            raise ModbusRefusal(ILLEGAL_ADDRESS)
        return self._at[address]


def word(address: int, get: Callable[[], int], put: Callable[[int], None] | None = None) -> Register:
    """An unsigned 16-bit number."""
    return Register(
        address=address,
        words=1,
        read=lambda: [get() & 0xFFFF],
        write=None if put is None else lambda words: put(words[0]),
    )


def signed_word(address: int, get: Callable[[], int], put: Callable[[int], None] | None = None) -> Register:
    """A 16-bit number in two's complement."""
    return word(address, get, None if put is None else lambda value: put(signed_from_word(value)))


def u32(
    address: int,
    get: Callable[[], int],
    put: Callable[[int], None] | None = None,
    *,
    word_order: WordOrder = "high_first",
) -> Register:
    """An unsigned 32-bit number in two registers."""
    return Register(
        address=address,
        words=2,
        read=lambda: words_from_u32(get() & 0xFFFFFFFF, word_order),
        write=None if put is None else lambda words: put(u32_from_words(words, word_order)),
    )


def f32(
    address: int,
    get: Callable[[], float],
    put: Callable[[float], None] | None = None,
    *,
    word_order: WordOrder = "high_first",
) -> Register:
    """An IEEE 754 single in two registers."""
    return Register(
        address=address,
        words=2,
        read=lambda: words_from_f32(get(), word_order),
        write=None if put is None else lambda words: put(f32_from_words(words, word_order)),
    )
