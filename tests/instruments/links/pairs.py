"""32-bit numbers of a Modbus unit, high word first."""

from __future__ import annotations

from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.protocols.modbus import f32_from_words, u32_from_words, words_from_f32, words_from_u32


def read_f32(link: ModbusLink, address: int) -> float:
    return f32_from_words(link.read(address, 2), "high_first")


def write_f32(link: ModbusLink, address: int, value: float) -> None:
    link.write(address, words_from_f32(value, "high_first"))


def read_u32(link: ModbusLink, address: int) -> int:
    return u32_from_words(link.read(address, 2), "high_first")


def write_u32(link: ModbusLink, address: int, value: int) -> None:
    link.write(address, words_from_u32(value, "high_first"))
