"""The registers of the LabJack T7 that the driver uses, and functions to read, write and check them.

A 32-bit number takes two registers, high word first. A refusal is answered with a bare Modbus exception; the T7 stores
its own, more specific code in LAST_ERR_DETAIL, one register. Source: LabJack's public register map, ljm_constants.json;
the flash is from LabJack's public C examples. Not tried on hardware.

The module also converts the stream's bytes to counts and volts. A scan of this bench holds

| count, low word | count, high word | gyro code | thermistor code |
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import ScanBlock
from benchctl_instruments.links.modbus import ModbusLink
from benchctl_instruments.protocols.modbus import f32_from_words, u32_from_words, words_from_f32, words_from_u32
from benchctl_instruments.protocols.t7_stream import SampleArray, ScanRun, StreamReader

_AS_WRITTEN = 1e-6
"""Largest relative change of a number by rounding to single precision."""

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
    """A register of the T7: its name in LabJack's map, its first register, and its type."""

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
    """Return the register with the address that is sampled as number `index` of a scan."""
    return Register(f"STREAM_SCANLIST_ADDRESS{index}", 4100 + 2 * index)


def ain(channel: int) -> Register:
    """Return the register of an analog input's voltage."""
    return Register(f"AIN{channel}", 2 * channel, "f32")


def ain_range(channel: int) -> Register:
    """Return the register of an analog input's ±range [V]."""
    return Register(f"AIN{channel}_RANGE", 40000 + 2 * channel, "f32")


def ain_negative(channel: int) -> Register:
    """Return the register of an analog input's negative channel; 199 is ground."""
    return Register(f"AIN{channel}_NEGATIVE_CH", 41000 + channel, "u16")


def ef_enable(line: int) -> Register:
    """Return the register that enables the extended feature of a digital line."""
    return Register(f"DIO{line}_EF_ENABLE", 44000 + 2 * line)


def ef_index(line: int) -> Register:
    """Return the register that selects a digital line's extended feature; it can be changed only while disabled."""
    return Register(f"DIO{line}_EF_INDEX", 44100 + 2 * line)


def ef_read_a(line: int) -> Register:
    """Return the register of the count of a digital line's extended feature, in two's complement for quadrature."""
    return Register(f"DIO{line}_EF_READ_A", 3000 + 2 * line)


class T7RefusalError(InstrumentError):
    """The T7 refused a request; `code` is LabJack's error code, or 0 if unknown."""

    def __init__(self, message: str, code: int) -> None:
        self.code = code
        super().__init__(message)


class T7Registers:
    """Registers over a Modbus link; methods raise `LinkError` without an answer and `T7RefusalError` for a refusal."""

    def __init__(self, link: ModbusLink) -> None:
        self._link = link

    def read(self, register: Register) -> float:
        """Return the number in a register."""
        try:
            return _number(register, self._link.read(register.address, 1 if register.kind == "u16" else WORDS))
        except InstrumentError as err:
            raise self._explained(err, f"reading {register.name}") from err

    def read_together(self, registers: Sequence[Register]) -> list[float]:
        """Return the numbers in 32-bit registers, in their order; consecutive registers are read with one request."""
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
        """Write a number; with `once` it is not repeated if no answer arrives."""
        try:
            self._link.write(register.address, _words(register, value), once=once)
        except InstrumentError as err:
            raise self._explained(err, f"writing {value:g} to {register.name}") from err

    def set(self, register: Register, value: float) -> None:
        """Write a number and read it back."""
        self.write(register, value)
        got = self.read(register)
        if not math.isclose(got, value, rel_tol=_AS_WRITTEN):
            raise InstrumentError(
                f"LabJack T7 at {self._link.address}: wrote {value:g} to {register.name}, acknowledged, reads "
                f"{got:g}; check that no other program uses it"
            )

    def keep(self, settings: Mapping[Register, float]) -> None:
        """Read registers and write only those that differ."""
        there = self.read_together(list(settings))
        for got, (register, value) in zip(there, settings.items(), strict=True):
            if not math.isclose(got, value, rel_tol=_AS_WRITTEN):
                self.set(register, value)

    def read_flash(self, flash_address: int, count: int) -> list[float]:
        """Return `count` singles from the internal flash."""
        self.set(FLASH_READ_POINTER, flash_address)
        try:
            words = self._link.read(FLASH_READ_ADDRESS, 2 * count)
        except InstrumentError as err:
            raise self._explained(err, "reading the internal flash") from err
        return [f32_from_words(words[at : at + 2], WORD_ORDER) for at in range(0, len(words), 2)]

    def _explained(self, err: InstrumentError, doing: str) -> T7RefusalError:
        try:
            (code,) = self._link.read(LAST_ERR_DETAIL.address)
        except InstrumentError:  # then only the bare refusal is known
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
    """Split registers into runs of consecutive ones, keeping their order."""
    runs: list[list[Register]] = []
    for register in registers:
        if runs and register.address == runs[-1][-1].address + WORDS:
            runs[-1].append(register)
        else:
            runs.append([register])
    return runs


SCAN_LENGTH = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class AinCalibration:
    """The T7's constants of one range: volts = (code - centre) · slope, with a slope [V] for each side of the centre.

    The slope of the lower side is negative and is applied to centre - code (T-series datasheet 20.0.1).
    """

    positive_slope: float
    negative_slope: float
    centre: float

    def check(self, range_v: float) -> None:
        """Raise `InstrumentError` if the constants do not fit a 16-bit converter over ±`range_v`."""
        slope = 2.0 * range_v / 65536
        expected = ((self.positive_slope, slope), (self.negative_slope, -slope), (self.centre, 32768.0))
        if not all(math.isclose(got, nominal, rel_tol=0.1) for got, nominal in expected):
            raise InstrumentError(
                f"expected the calibration of the ±{range_v:g} V range, slopes near ±{slope:.4g}, a centre near 32768, "
                f"got {self.positive_slope:.4g}, {self.negative_slope:.4g} and {self.centre:.6g}"
            )

    def volts(self, codes: SampleArray) -> FloatArray:
        """Return the volts of streamed codes, of the same shape."""
        from_centre = codes.astype(np.float64) - self.centre
        slopes: FloatArray = np.where(from_centre < 0.0, -self.negative_slope, self.positive_slope)
        return from_centre * slopes


class ScanQueue:
    """Queue of the received scans of one stream: takes bytes and returns blocks."""

    def __init__(self, calibration: AinCalibration) -> None:
        self._calibration = calibration
        self._reader = StreamReader(SCAN_LENGTH)
        self._runs: list[ScanRun] = []
        self._last_count: int | None = None

    @property
    def junk_bytes(self) -> int:
        """Number of bytes of the stream that belonged to no packet."""
        return self._reader.junk_bytes

    def resume(self) -> None:
        """Continue with the bytes of a new connection of the same stream."""
        self._reader.resume()

    def feed(self, data: bytes) -> None:
        """Add received bytes; raises like `StreamReader.feed`."""
        for run in self._reader.feed(data):
            if self._runs and self._runs[-1].next_index == run.first_index:
                self._runs[-1] = _joined(self._runs[-1], run)
            else:
                self._runs.append(run)

    def ready(self, scans: int) -> bool:
        """Return whether a block of `scans` scans, or a shorter one that ends at a gap, is available."""
        return self.waiting >= scans or len(self._runs) > 1

    @property
    def waiting(self) -> int:
        """Number of available scans up to the next gap."""
        return len(self._runs[0].samples) if self._runs else 0

    def take(self) -> ScanBlock:
        """Return all scans up to the next gap; the queue must not be empty."""
        run = self._runs.pop(0)
        return ScanBlock(
            first_index=run.first_index,
            encoder_count=self._unwrapped(run.samples[:, 0], run.samples[:, 1]),
            gyro_v=self._calibration.volts(run.samples[:, 2]),
            thermistor_v=self._calibration.volts(run.samples[:, 3]),
            backlog=self._reader.backlog_scans,
        )

    def _unwrapped(self, low: SampleArray, high: SampleArray) -> IntArray:
        """Return signed counts, continued across wraps of the 32-bit counter and across gaps."""
        count = (low | high.astype(np.uint32) << 16).view(np.int32).astype(np.int64)
        before = int(count[0]) if self._last_count is None else self._last_count
        steps = np.diff(count, prepend=before)
        unwrapped = before + np.cumsum((steps + 0x80000000) % 0x100000000 - 0x80000000)
        self._last_count = int(unwrapped[-1])
        return unwrapped


def _joined(first: ScanRun, then: ScanRun) -> ScanRun:
    return ScanRun(first_index=first.first_index, samples=np.concatenate((first.samples, then.samples)))
