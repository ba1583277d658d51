"""Numbers in 16-bit registers: two's complement, and 32-bit numbers in two registers, high or low word first.

Modbus knows registers of 16 bits and nothing of what they mean. Which word of a 32-bit number comes first is the
device's own choice (LabJack: high first; Watlow F4T as delivered: low first) and the commonest reason for readings like
1e-12 or 1e34.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Literal, cast

WordOrder = Literal["high_first", "low_first"]


def signed_from_word(word: int) -> int:
    """-32768 ... 32767 from a word in two's complement."""
    return word - 0x10000 if word > 0x7FFF else word


def word_from_signed(value: int) -> int:
    """A word in two's complement; `ValueError` beyond -32768 ... 32767."""
    if not -0x8000 <= value <= 0x7FFF:
        raise ValueError(f"{value} does not fit into a signed 16-bit register")
    return value & 0xFFFF


def f32_from_words(words: Sequence[int], word_order: WordOrder) -> float:
    """An IEEE 754 single from two words."""
    return cast(float, struct.unpack(">f", _bytes(words, word_order))[0])


def words_from_f32(value: float, word_order: WordOrder) -> list[int]:
    """Two words of an IEEE 754 single; `OverflowError` where it is too large for one."""
    return _words(struct.pack(">f", value), word_order)


def u32_from_words(words: Sequence[int], word_order: WordOrder) -> int:
    """An unsigned 32-bit number from two words."""
    return int.from_bytes(_bytes(words, word_order), "big")


def words_from_u32(value: int, word_order: WordOrder) -> list[int]:
    """Two words of an unsigned 32-bit number; `OverflowError` where it does not fit."""
    return _words(value.to_bytes(4, "big"), word_order)


def _bytes(words: Sequence[int], word_order: WordOrder) -> bytes:
    first, second = words
    return struct.pack(">HH", first, second) if word_order == "high_first" else struct.pack(">HH", second, first)


def _words(data: bytes, word_order: WordOrder) -> list[int]:
    high, low = struct.unpack(">HH", data)
    return [high, low] if word_order == "high_first" else [low, high]
