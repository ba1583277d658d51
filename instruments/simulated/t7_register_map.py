"""LabJack's register map of the T7 as data, and the inputs of a simulated one.

Stored registers can be written and read back and have no effect, except those to which `labjack_t7` gives one. Not
simulated, and so unknown: serial buses, Lua, files, Wi-Fi, AIN_EF, the real-time clock, Mux80 inputs (AIN14 to 254 read
0 V).

Source: ljm_constants.json (LabJack's public map); STREAM_DATATYPE (4018) T-series datasheet 3.2.4; flash 20.0.1 and the
nominal constants of NSchrading/async_labjack (calibrations.rs).

The inputs: as delivered the encoder is on DIO0 and DIO1, the gyro on AIN0, its thermistor on AIN1; the other analog
inputs read 0 V. Streamed volts are 16-bit codes; the slow converter of single readings resolves 24 bits. Both are
ideal. Enabling quadrature does not change the count.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.physics.adc import codes_from_volts, volts_from_codes
from benchctl_instruments.simulated.machines import SINGLE_READING_S, AnalogInputs

Kind = Literal["u16", "u32", "f32"]
WORDS: dict[Kind, int] = {"u16": 1, "u32": 2, "f32": 2}
ANALOG_INPUTS, DIGITAL_LINES, SCAN_LIST_LENGTH = 255, 23, 128
RANGES_V = (10.0, 1.0, 0.1, 0.01)


@dataclass(frozen=True, slots=True)
class Row:
    """Consecutive registers: the first address, the kind, how many, and their value as delivered."""

    address: int
    kind: Kind
    count: int = 1
    delivered: float = 0


KEPT = (
    Row(1000, "f32", 2),  # DAC
    Row(2000, "u16", DIGITAL_LINES, 1),  # DIO
    Row(2500, "u16", 4),  # FIO, EIO, CIO, MIO: STATE
    Row(2580, "u16", 3),
    Row(2600, "u16", 4),  # DIRECTION
    Row(2800, "u32"),  # DIO_STATE, DIRECTION, INHIBIT
    Row(2850, "u32"),
    Row(2900, "u32"),
    Row(2990, "u16", 2),  # LED_COMM, LED_STATUS
    Row(4004, "u32", 2),  # STREAM_NUM_ADDRESSES, SAMPLES_PER_PACKET
    Row(4008, "f32"),  # SETTLING_US
    Row(4010, "u32", 8),  # RESOLUTION_INDEX ... TRIGGER_INDEX
    *(Row(address, "u32", 4) for address in (4040, 4050, 4060, 4090)),  # STREAM_OUT
    Row(4100, "u32", SCAN_LIST_LENGTH),
    Row(40000, "f32", ANALOG_INPUTS, 10.0),  # AIN_RANGE
    Row(41000, "u16", ANALOG_INPUTS, 199),  # NEGATIVE_CH
    Row(41500, "u16", ANALOG_INPUTS),  # RESOLUTION_INDEX
    Row(42000, "f32", ANALOG_INPUTS),  # SETTLING_US
    Row(43906, "u32"),  # AIN_ALL_EF_INDEX
    *(Row(address, "u32", DIGITAL_LINES) for address in range(44000, 44700, 100)),  # DIO_EF_ENABLE, INDEX ... CONFIG_D
    *(Row(clock, "u16", 2) for clock in (44900, 44910, 44920)),  # DIO_EF_CLOCK: ENABLE, DIVISOR
    *(Row(clock + 2, "u32", 2) for clock in (44900, 44910, 44920)),  # OPTIONS, ROLL_VALUE
    Row(46000, "f32", 40),  # USER_RAM
    Row(46080, "u32", 10),
    Row(46100, "u32", 40),
    Row(46180, "u16", 20),
    Row(48003, "u16", 4, 1),  # POWER
    Row(48053, "u16", 4, 1),
    Row(49150, "u32", 5),  # ETHERNET, DEFAULT
    Row(49160, "u16", 1, 1),
    Row(55110, "u16", 1, 0x0011),  # TEST_UINT16, UINT32, INT32, FLOAT32
    Row(55120, "u32", 1, 0x00112233),
    Row(55122, "u32", 1, 0x8899AABB),
    Row(55124, "f32", 1, -9999.0),
    Row(61590, "u32"),  # WAIT_US_BLOCKING
    Row(61600, "u32", 4),  # WATCHDOG
    Row(61610, "u32", 2),
    Row(61620, "u32"),
    Row(61630, "u32", 4),
    Row(61640, "u32"),
    Row(61642, "f32"),
    Row(61650, "u32"),
    Row(61652, "f32"),
)

STATED = (
    Row(1900, "f32", 1, 10e-6),  # CURRENT_SOURCE_10UA_CAL_VALUE, 200UA
    Row(1902, "f32", 1, 200e-6),
    Row(3200, "u32", DIGITAL_LINES),  # DIO_EF_READ_B
    *(Row(address, "f32", DIGITAL_LINES) for address in (3500, 3600, 3700)),  # READ_A_F, AND_RESET, READ_B_F
    *(Row(clock + 8, "u32") for clock in (44900, 44910, 44920)),  # DIO_EF_CLOCK_COUNT
    Row(49000, "u32", 1, 1),  # IO_CONFIG_CHECK_FOR_FACTORY
    Row(49100, "u32", 1, 0x7F000001),  # ETHERNET_IP, SUBNET, GATEWAY, DNS, ALTDNS, DHCP_ENABLE
    Row(49102, "u32", 1, 0xFF000000),
    Row(49104, "u32", 3),
    Row(49110, "u16"),
    Row(55100, "u32", 1, 0x00112233),  # TEST
    Row(60000, "f32", 1, 7.0),  # PRODUCT_ID
    Row(60002, "f32", 1, 1.35),  # HARDWARE_VERSION
    Row(60004, "f32", 1, 1.0292),  # FIRMWARE_VERSION
    Row(60006, "f32", 1, 0.97),  # BOOTLOADER_VERSION
    Row(60008, "f32"),  # WIFI_VERSION
    Row(60010, "u32"),  # HARDWARE_INSTALLED
    Row(60020, "u32", 1, 0x90A2),  # ETHERNET_MAC, WIFI_MAC
    Row(60022, "u32", 1, 0xDA001234),
    Row(60024, "u32", 2),
    Row(60050, "f32", 1, 293.65),  # TEMPERATURE_AIR_K, DEVICE_K
    Row(60052, "f32", 1, 298.55),
)

ACCEPTED = (  # these can only be written
    Row(4070, "u32", 4),  # STREAM_OUT_SET_LOOP
    Row(49002, "u32"),  # IO_CONFIG_SET_DEFAULT_TO_CURRENT, TO_FACTORY
    Row(49004, "u32"),
    Row(61614, "u32"),  # WATCHDOG_STRICT_CLEAR
    Row(61990, "u16", 2),  # IO_CONFIG_SET_CURRENT_TO_FACTORY, TO_DEFAULT
)

ALL_INPUTS = {43900: 40000, 43902: 41000, 43903: 41500, 43904: 42000}
"""AIN_ALL_RANGE, NEGATIVE_CH, RESOLUTION_INDEX, SETTLING_US, and the first register of those that each one sets."""

MIXED: dict[Kind, float] = {"f32": -9999.0, "u16": 0xFFFF}
"""The value of AIN_ALL if the inputs differ."""


FLASH_CALIBRATION = 0x3C4000
CALIBRATION_WORDS = 82


def flash(address: int) -> list[int]:
    """Return words of the internal flash from an address on: the calibration, nominal, and FFFFh elsewhere."""
    converters = [(span_v / 32768, -span_v / 32768, 32768.0, -span_v) for span_v in RANGES_V]  # slopes, centre, offset
    outputs, thermometer, currents = (13200.0, 0.0) * 2, (-92.6, 467.6), (10e-6, 200e-6, 15e-9)
    constants = [*sum(converters * 2, ()), *outputs, *thermometer, *currents]  # converters of streams, of slow readings
    words = struct.unpack(f">{CALIBRATION_WORDS}H", struct.pack(f">{len(constants)}f", *constants))
    first = (address - FLASH_CALIBRATION) // 2
    found = words[first:] if 0 <= first < CALIBRATION_WORDS else ()
    return [*found, *[0xFFFF] * (CALIBRATION_WORDS - len(found))]


def each(rows: Iterable[Row]) -> Iterator[tuple[int, Kind, float]]:
    """Yield every register of some rows: address, kind, value as delivered."""
    for row in rows:
        for place in range(row.count):
            yield row.address + place * WORDS[row.kind], row.kind, row.delivered


QUADRATURE = 10
RANGE, EF_ENABLE, EF_INDEX = 40000, 44000, 44100
DATA_CAPTURE_16 = 4899
READ_A_0 = 3000
HIGHEST_STREAMED_CODE = 0xFFFE  # FFFFh marks skipped scans only


@dataclass(slots=True)
class T7Terminals:
    """The inputs; `settings` are LabJack's registers, address -> value.

    `encoder_channel` is the digital line of the encoder's phase A, phase B is on the next one; `gyro_ain` and
    `thermistor_ain` are the analog inputs to which those two are wired. `zero` is the count at the last reset.
    """

    inputs: AnalogInputs
    settings: Mapping[int, float]
    encoder_channel: int = 0
    gyro_ain: int = 0
    thermistor_ain: int = 1
    zero: int = 0

    def single_code(self, channel: int) -> int:
        """Return a single reading of an analog input, 24 bits."""
        _, gyro_v, thermistor_v = self._now()
        volts = self._wired(channel, gyro_v, thermistor_v)
        return int(codes_from_volts(volts, range_v=self._range_v(channel), bits=24)[0])

    def single_volts(self, channel: int) -> float:
        """Return a single reading of an analog input in volts."""
        code = np.array([self.single_code(channel)])
        return float(volts_from_codes(code, range_v=self._range_v(channel), bits=24)[0])

    def count(self, line: int, *, reset: bool = False) -> int:
        """Return the count of a pair of lines, 0 if it is not wired or quadrature is off; optionally reset it to 0."""
        if not self._counts(line):
            return 0
        count = int(self._now()[0][0])
        since_reset = count - self.zero
        if reset:
            self.zero = count
        return since_reset

    def can_stream(self, scan_list: Sequence[int]) -> bool:
        """Return whether every address of a scan list can be sampled here."""
        analog = {2 * channel for channel in range(ANALOG_INPUTS)}
        counts = {READ_A_0 + 2 * line for line in range(DIGITAL_LINES)}
        known = analog | counts | {DATA_CAPTURE_16}
        return bool(scan_list) and scan_list[0] != DATA_CAPTURE_16 and all(address in known for address in scan_list)

    def scans(
        self, scan_list: Sequence[int], first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> npt.NDArray[np.uint16]:
        """Return samples of each address at equidistant instants from scan `start` on, shape (scans, addresses)."""
        count, gyro_v, thermistor_v = self.inputs.sample(first_s, interval_s, scans, start=start)
        count = count - self.zero
        samples = np.empty((scans, len(scan_list)), np.uint16)
        upper: IntArray | int = 0  # value of DATA_CAPTURE_16: the upper half of the number before it
        for place, address in enumerate(scan_list):
            if address == DATA_CAPTURE_16:
                samples[:, place] = upper
            elif address >= READ_A_0:
                value = count if self._counts((address - READ_A_0) // 2) else np.zeros(scans, np.int64)
                samples[:, place], upper = value & 0xFFFF, value >> 16 & 0xFFFF
            else:
                volts = self._wired(address // 2, gyro_v, thermistor_v)
                codes = codes_from_volts(volts, range_v=self._range_v(address // 2))
                samples[:, place] = np.minimum(codes, HIGHEST_STREAMED_CODE)
        return samples

    def _wired(self, channel: int, gyro_v: FloatArray, thermistor_v: FloatArray) -> FloatArray:
        wired = {self.gyro_ain: gyro_v, self.thermistor_ain: thermistor_v}
        return wired.get(channel, np.zeros_like(gyro_v))

    def _counts(self, line: int) -> bool:
        places = (self.encoder_channel, self.encoder_channel + 1)
        return line in places and all(
            self.settings[EF_ENABLE + 2 * place] and self.settings[EF_INDEX + 2 * place] == QUADRATURE
            for place in places
        )

    def _range_v(self, channel: int) -> float:
        return self.settings[RANGE + 2 * channel]

    def _now(self) -> tuple[IntArray, FloatArray, FloatArray]:
        return self.inputs.sample(self.inputs.now(), SINGLE_READING_S, 1)
