"""The registers of the LabJack T7 that are used here, and how to read, write and check them.

A 32-bit number takes two registers, high word first. A refusal comes as a bare Modbus exception; the T7 keeps its own,
more telling code in LAST_ERR_DETAIL, one register. Source: LabJack's public register map, ljm_constants.json; the flash
is from LabJack's public C examples. Not tried on hardware.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.protocols.words import f32_from_words, u32_from_words, words_from_f32, words_from_u32

_AS_WRITTEN = 1e-6
"""What the rounding to a single may change of a number."""

WORD_ORDER: Literal["high_first"] = "high_first"
WORDS = 2  # of a 32-bit number

ERROR_WORDS = {
    2603: "not possible in spontaneous mode",
    2605: "a stream is running",
    2607: "the scan list is invalid",
    2608: "the scan rate is invalid",
    2612: "the target is invalid",
    2615: "the buffer size is invalid",
    2618: "the number of samples a packet is invalid",
    2620: "no stream is running",
}
NOT_RUNNING = 2620


@dataclass(frozen=True, slots=True)
class Register:
    """A quantity: its name in LabJack's map, its first register, and what it is there."""

    name: str
    address: int
    kind: Literal["u16", "u32", "f32"] = "u32"


TEST = Register("TEST", 55100)
TEST_VALUE, TEST_VALUE_SWAPPED = 0x00112233, 0x22330011
LAST_ERR_DETAIL = Register("LAST_ERR_DETAIL", 55000, "u16")
PRODUCT_ID = Register("PRODUCT_ID", 60000, "f32")
FIRMWARE_VERSION = Register("FIRMWARE_VERSION", 60004, "f32")
SERIAL_NUMBER = Register("SERIAL_NUMBER", 60028)
CORE_TIMER = Register("CORE_TIMER", 61520)
FLASH_READ_POINTER = Register("INTERNAL_FLASH_READ_POINTER", 61810)
FLASH_READ_ADDRESS = 61812

STREAM_SCANRATE_HZ = Register("STREAM_SCANRATE_HZ", 4002, "f32")
STREAM_NUM_ADDRESSES = Register("STREAM_NUM_ADDRESSES", 4004)
STREAM_SAMPLES_PER_PACKET = Register("STREAM_SAMPLES_PER_PACKET", 4006)
STREAM_SETTLING_US = Register("STREAM_SETTLING_US", 4008, "f32")
STREAM_RESOLUTION_INDEX = Register("STREAM_RESOLUTION_INDEX", 4010)
STREAM_BUFFER_SIZE_BYTES = Register("STREAM_BUFFER_SIZE_BYTES", 4012)
STREAM_CLOCK_SOURCE = Register("STREAM_CLOCK_SOURCE", 4014)
STREAM_AUTO_TARGET = Register("STREAM_AUTO_TARGET", 4016)
STREAM_DATATYPE = Register("STREAM_DATATYPE", 4018)
STREAM_NUM_SCANS = Register("STREAM_NUM_SCANS", 4020)
STREAM_TRIGGER_INDEX = Register("STREAM_TRIGGER_INDEX", 4024)
STREAM_START_TIME_STAMP = Register("STREAM_START_TIME_STAMP", 4026)
STREAM_DATA_CAPTURE_16 = Register("STREAM_DATA_CAPTURE_16", 4899, "u16")
STREAM_ENABLE = Register("STREAM_ENABLE", 4990)


def stream_scanlist(index: int) -> Register:
    """The address that is sampled as number `index` of a scan."""
    return Register(f"STREAM_SCANLIST_ADDRESS{index}", 4100 + 2 * index)


def ain(channel: int) -> Register:
    """The voltage of an analog input."""
    return Register(f"AIN{channel}", 2 * channel, "f32")


def ain_range(channel: int) -> Register:
    """The ±range [V] of an analog input."""
    return Register(f"AIN{channel}_RANGE", 40000 + 2 * channel, "f32")


def ain_negative(channel: int) -> Register:
    """The channel against which an analog input is measured; 199 is ground."""
    return Register(f"AIN{channel}_NEGATIVE_CH", 41000 + channel, "u16")


def ef_enable(line: int) -> Register:
    """Whether the extended feature of a digital line runs."""
    return Register(f"DIO{line}_EF_ENABLE", 44000 + 2 * line)


def ef_index(line: int) -> Register:
    """Which extended feature a digital line has; it can be changed only while it does not run."""
    return Register(f"DIO{line}_EF_INDEX", 44100 + 2 * line)


def ef_read_a(line: int) -> Register:
    """The count of a digital line's extended feature, in two's complement for quadrature."""
    return Register(f"DIO{line}_EF_READ_A", 3000 + 2 * line)


class T7RefusalError(InstrumentError):
    """The T7 refused a request; `code` is LabJack's error code, 0 where it has none."""

    def __init__(self, message: str, code: int) -> None:
        self.code = code
        super().__init__(message)


class T7Registers:
    """Registers over a Modbus link; everything raises `LinkError` for silence and `T7RefusalError` for a refusal."""

    def __init__(self, link: ModbusLink) -> None:
        self._link = link

    def read(self, register: Register) -> float:
        """The number in a register."""
        try:
            return _number(register, self._link.read(register.address, 1 if register.kind == "u16" else WORDS))
        except InstrumentError as err:
            raise self._explained(err, f"reading {register.name}") from err

    def read_together(self, registers: Sequence[Register]) -> list[float]:
        """The numbers in 32-bit registers, in their order; those that follow on each other come with one request."""
        numbers: list[float] = []
        for run in _runs(registers):
            try:
                words = self._link.read(run[0].address, WORDS * len(run))
            except InstrumentError as err:
                raise self._explained(err, f"reading {', '.join(register.name for register in run)}") from err
            for place, register in enumerate(run):
                numbers.append(_number(register, words[WORDS * place : WORDS * (place + 1)]))
        return numbers

    def write(self, register: Register, value: float, *, once: bool = False) -> None:
        """Write a number; `once` does not repeat it where no answer comes."""
        try:
            self._link.write(register.address, _words(register, value), once=once)
        except InstrumentError as err:
            raise self._explained(err, f"writing {value:g} to {register.name}") from err

    def set(self, register: Register, value: float) -> None:
        """Write a number and make sure that it is there."""
        self.write(register, value)
        got = self.read(register)
        if not math.isclose(got, value, rel_tol=_AS_WRITTEN):
            raise InstrumentError(
                f"LabJack T7 at {self._link.address}: wrote {value:g} to {register.name}, acknowledged, reads "
                f"{got:g}; check that no other program uses it"
            )

    def keep(self, settings: Mapping[Register, float]) -> None:
        """Make sure that numbers are there, and write only those that are not."""
        there = self.read_together(list(settings))
        for got, (register, value) in zip(there, settings.items(), strict=True):
            if not math.isclose(got, value, rel_tol=_AS_WRITTEN):
                self.set(register, value)

    def read_flash(self, flash_address: int, count: int) -> list[float]:
        """`count` singles from the internal flash."""
        self.set(FLASH_READ_POINTER, flash_address)
        try:
            words = self._link.read(FLASH_READ_ADDRESS, 2 * count)
        except InstrumentError as err:
            raise self._explained(err, "reading the internal flash") from err
        return [f32_from_words(words[at : at + 2], WORD_ORDER) for at in range(0, len(words), 2)]

    def _explained(self, err: InstrumentError, doing: str) -> T7RefusalError:
        try:
            (code,) = self._link.read(LAST_ERR_DETAIL.address)
        except InstrumentError:  # then the bare refusal has to do
            code = 0
        reason = f": LabJack error {code}, {ERROR_WORDS.get(code, 'see its list of errors')}" if code else ""
        return T7RefusalError(f"{err} ({doing}{reason})", code)


def _words(register: Register, value: float) -> list[int]:
    if register.kind == "f32":
        return words_from_f32(value, WORD_ORDER)
    return [int(value)] if register.kind == "u16" else words_from_u32(int(value), WORD_ORDER)


def _number(register: Register, words: Sequence[int]) -> float:
    if register.kind == "f32":
        return f32_from_words(words, WORD_ORDER)
    return words[0] if register.kind == "u16" else u32_from_words(words, WORD_ORDER)


def _runs(registers: Sequence[Register]) -> list[list[Register]]:
    """Registers in their order, parted wherever the next one does not follow on the one before."""
    runs: list[list[Register]] = []
    for register in registers:
        if runs and register.address == runs[-1][-1].address + WORDS:
            runs[-1].append(register)
        else:
            runs.append([register])
    return runs
