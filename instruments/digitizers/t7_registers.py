"""The registers of the LabJack T7 that are used here, and how to read, write and check them.

A 32-bit number takes two registers, high word first. A refusal comes as a bare Modbus exception; the T7 keeps its own,
more telling code in LAST_ERR_DETAIL, one register. Source: LabJack's public register map, ljm_constants.json; the flash
is from LabJack's public C examples. Not tried on hardware.

The stream's bytes become counts and volts. A scan of this bench holds

| count, low word | count, high word | gyro code | thermistor code |

Scans are watched for what no sound bench produces: a count that jumps, frozen inputs, a thermistor at its rail.
A T7's converters are never so quiet that the codes of two inputs stay the same for seconds, and a table is never so
fast that its encoder's count jumps from one scan to the next, and a thermistor's amplifier is at the converter's rail
where it is open or shorted: the data are worth nothing from there on. The gyro may well be at its rail, by its rate.
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
        """Raise `InstrumentError` where these cannot be the constants of a 16-bit converter over ±`range_v`."""
        slope = 2.0 * range_v / 65536
        expected = ((self.positive_slope, slope), (self.negative_slope, -slope), (self.centre, 32768.0))
        if not all(math.isclose(got, nominal, rel_tol=0.1) for got, nominal in expected):
            raise InstrumentError(
                f"expected the calibration of the ±{range_v:g} V range, slopes near ±{slope:.4g}, a centre near 32768, "
                f"got {self.positive_slope:.4g}, {self.negative_slope:.4g} and {self.centre:.6g}"
            )

    def volts(self, codes: SampleArray) -> FloatArray:
        """Volts of streamed codes, shape as given."""
        from_centre = codes.astype(np.float64) - self.centre
        slopes: FloatArray = np.where(from_centre < 0.0, -self.negative_slope, self.positive_slope)
        return from_centre * slopes


class ScanQueue:
    """The scans of one stream that have come and were not taken yet; bytes in, blocks out."""

    def __init__(self, calibration: AinCalibration) -> None:
        self._calibration = calibration
        self._reader = StreamReader(SCAN_LENGTH)
        self._runs: list[ScanRun] = []
        self._last_count: int | None = None

    @property
    def junk_bytes(self) -> int:
        """How many bytes of the stream belonged to no packet."""
        return self._reader.junk_bytes

    def resume(self) -> None:
        """Go on with the bytes of a new connection of the same stream."""
        self._reader.resume()

    def feed(self, data: bytes) -> None:
        """Take bytes as they come; raises as `StreamReader.feed` does."""
        for run in self._reader.feed(data):
            if self._runs and self._runs[-1].next_index == run.first_index:
                self._runs[-1] = _joined(self._runs[-1], run)
            else:
                self._runs.append(run)

    def ready(self, scans: int) -> bool:
        """Whether a block of that many scans can be taken, or a shorter one that a gap ends."""
        return self.waiting >= scans or len(self._runs) > 1

    @property
    def waiting(self) -> int:
        """How many scans wait up to the next gap."""
        return len(self._runs[0].samples) if self._runs else 0

    def take(self) -> ScanBlock:
        """All scans that wait up to the next gap; there must be some."""
        run = self._runs.pop(0)
        return ScanBlock(
            first_index=run.first_index,
            encoder_count=self._unwrapped(run.samples[:, 0], run.samples[:, 1]),
            gyro_v=self._calibration.volts(run.samples[:, 2]),
            thermistor_v=self._calibration.volts(run.samples[:, 3]),
            backlog=self._reader.backlog_scans,
        )

    def _unwrapped(self, low: SampleArray, high: SampleArray) -> IntArray:
        """Signed counts that go on where the counter's 32 bits wrap, across gaps too."""
        count = (low | high.astype(np.uint32) << 16).view(np.int32).astype(np.int64)
        before = int(count[0]) if self._last_count is None else self._last_count
        steps = np.diff(count, prepend=before)
        unwrapped = before + np.cumsum((steps + 0x80000000) % 0x100000000 - 0x80000000)
        self._last_count = int(unwrapped[-1])
        return unwrapped


def _joined(first: ScanRun, then: ScanRun) -> ScanRun:
    return ScanRun(first_index=first.first_index, samples=np.concatenate((first.samples, then.samples)))


SPARE_COUNTS = 100.0
"""Beside what the fastest table makes in one scan interval: an encoder's own errors, and vibration."""

AT_RAIL = 0.999  # of the range


class ScanWatch:
    """Watches the scans of one stream; `look` is to be called with every block, in order.

    Parameters
    ----------
    rate_hz
        The scan rate.
    fastest_counts_per_s
        How fast the encoder can count at most; infinite: any jump may be motion.
    range_v
        The converter's ±range.
    frozen_s
        After this time without any change on any input they count as frozen; infinite: never.
    """

    def __init__(self, rate_hz: float, *, fastest_counts_per_s: float, range_v: float, frozen_s: float) -> None:
        self._range_v = range_v
        self._most_counts = fastest_counts_per_s / rate_hz + SPARE_COUNTS
        self._most_still = frozen_s * rate_hz
        self._rate_hz = rate_hz
        self._still = 0  # scans since the last change
        self._next_index = 0
        self._last: FloatArray | None = None  # the scan before the next one, shape (3, 1)

    def look(self, block: ScanBlock) -> None:
        """Raise `InstrumentError` where the count jumps, the thermistor is at its rail, or nothing changes any more."""
        scans = np.stack([block.encoder_count.astype(np.float64), block.gyro_v, block.thermistor_v])
        first = block.first_index
        if self._last is not None and block.first_index == self._next_index:
            scans = np.concatenate([self._last, scans], axis=1)
            first -= 1
        else:
            self._still = 0
        steps = np.diff(scans, axis=1)
        self._last, self._next_index = scans[:, -1:], block.first_index + len(block.gyro_v)
        self._refuse_a_jump(steps[0], first)
        refuse_at_rail(float(np.median(block.thermistor_v)), self._range_v)
        changes = np.flatnonzero(steps.any(axis=0))
        self._still = self._still + steps.shape[1] if not len(changes) else steps.shape[1] - 1 - int(changes[-1])
        if self._still >= self._most_still:
            raise InstrumentError(
                f"count, gyro and thermistor have not changed by a single code for {self._still / self._rate_hz:.1f} s:"
                " the converter or its inputs hang; check the wiring and switch it off and on"
            )

    def _refuse_a_jump(self, steps: FloatArray, first: int) -> None:
        jumps = np.flatnonzero(np.abs(steps) > self._most_counts)
        if len(jumps):
            scan = first + int(jumps[0]) + 1
            raise InstrumentError(
                f"the encoder's count jumps by {int(steps[jumps[0]])} at scan {scan}"
                f" ({scan / self._rate_hz:.3f} s after the start of the stream), a table cannot turn so fast;"
                " check the encoder's cable and shield, its angle is lost"
            )


def refuse_at_rail(thermistor_v: float, range_v: float) -> None:
    """Raise `InstrumentError` where the thermistor's volts are all that the converter can state."""
    if abs(thermistor_v) >= AT_RAIL * range_v:
        raise InstrumentError(
            f"the thermistor reads {thermistor_v:+.2f} V, the end of its range: there is no temperature;"
            " check the thermistor, its amplifier and the wiring"
        )
