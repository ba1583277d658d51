"""The datagrams of a Sensonor STIM300: measurements of three gyros, and of other sensors as ordered.

    | id 1 | gyro | acceleration | inclination | temperature of each | auxiliary | counter 1 | latency 2 | CRC 4 |

    gyro, acceleration, inclination: | X i24 | Y i24 | Z i24 | status 1 |
    temperature of each of them:     | X i16 | Y i16 | Z i16 | status 1 |       auxiliary: | i24 | status 1 |

Numbers are big-endian; the id determines which parts exist. The CRC-32/MPEG-2 covers all preceding bytes, padded with
zero bytes, which are not sent, to a multiple of four. CR LF ends a datagram if the STIM300 is configured so. `latency`
is the time [µs] from the sample to its first byte on the wire. The host asks with one letter and CR; the answers are
sent between measurements:

    host "C" CR  ->  | BC, or BD with CR LF | 21 bytes, see below | CRC 4 | CR LF |
    host "I" CR  ->  | B5, or B7 with CR LF | "N" | 14 digits, two a byte | 7 reserved | CRC 4 | CR LF |

    | revision 1 | firmware 1 | rate 3 bits, auxiliary, temperature, inclination, acceleration, CR LF a bit each |
    | line 1 | gyro axes 4 bits, gyro unit 4 bits | 16 more, of filters and of the other sensors |

Source: vortexntnu stim300-driver, stim300_constants.hpp and datagram_parser.cpp (ids, parts, padding, scales);
rock-drivers imu_stim300, stim300.hpp (layout, latency, counter). Not tried on hardware; layout and CRC agree with a
datagram of a real STIM300 that geirhovland/stim300 shows. The sources differ on the increment of the counter from one
datagram to the next, so this module assumes none.

Source of the answers: vortexntnu stim300-driver, datagram_parser.cpp and driver_stim300.cpp (configuration);
cookednoodle pystim300, datagrams.py and client.py (serial number, the letter that asks for it). Not tried on hardware.
The sources interpret units of the gyro beyond the first four differently, so they are refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.frames import ByteArray, FrameFormat

Part = Literal["gyro", "acceleration", "inclination", "temperature", "auxiliary"]

DEFAULT_BAUD = 921_600
COUNTERS = 256
CRLF = b"\r\n"

PARTS: dict[int, tuple[Part, ...]] = {
    0x90: ("gyro",),
    0x91: ("gyro", "acceleration"),
    0x92: ("gyro", "inclination"),
    0x93: ("gyro", "acceleration", "inclination"),
    0x94: ("gyro", "temperature"),
    0xA5: ("gyro", "acceleration", "temperature"),
    0xA6: ("gyro", "inclination", "temperature"),
    0xA7: ("gyro", "acceleration", "inclination", "temperature"),
    0x98: ("gyro", "auxiliary"),
    0x99: ("gyro", "acceleration", "auxiliary"),
    0x9A: ("gyro", "inclination", "auxiliary"),
    0x9B: ("gyro", "acceleration", "inclination", "auxiliary"),
    0x9C: ("gyro", "temperature", "auxiliary"),
    0xAD: ("gyro", "acceleration", "temperature", "auxiliary"),
    0xAE: ("gyro", "inclination", "temperature", "auxiliary"),
    0xAF: ("gyro", "acceleration", "inclination", "temperature", "auxiliary"),
}

RATE_STEP_DPS = 2.0**-14
ANGLE_STEP_DEG = 2.0**-21
TEMPERATURE_STEP_C = 2.0**-8

STATUS_WORDS = {
    7: "system integrity error",
    6: "starting up",
    5: "outside operating conditions",
    4: "overload",
    3: "error in a measurement channel",
}
AFFECTED_AXES = {0: "X", 1: "Y", 2: "Z"}
_FIELDS: dict[Part, list[tuple[Any, ...]]] = {
    "gyro": [("gyro", "u1", (3, 3)), ("gyro_status", "u1")],
    "acceleration": [("acceleration", "u1", (3, 3)), ("acceleration_status", "u1")],
    "inclination": [("inclination", "u1", (3, 3)), ("inclination_status", "u1")],
    "auxiliary": [("auxiliary", "u1", (1, 3)), ("auxiliary_status", "u1")],
}


def contents_type(datagram_id: int) -> np.dtype[np.void]:
    """Return the layout of a datagram up to its CRC; numbers of three bytes are fields of bytes, shape (…, 3)."""
    parts = PARTS[datagram_id]
    fields: list[tuple[Any, ...]] = [("id", "u1")]
    for part in parts:
        if part == "temperature":
            measured = (other for other in parts if other not in ("temperature", "auxiliary"))
            for other in measured:
                fields += [(f"{other}_temperature", ">i2", (3,)), (f"{other}_temperature_status", "u1")]
        else:
            fields += _FIELDS[part]
    return np.dtype([*fields, ("counter", "u1"), ("latency_us", ">u2")])


def frame_format(datagram_id: int, *, crlf: bool = False) -> FrameFormat:
    """Return the frame format of a datagram."""
    crc_at = contents_type(datagram_id).itemsize
    return FrameFormat(
        name=f"STIM300 datagram {datagram_id:02X}h",
        header=bytes([datagram_id]),
        crc_at=crc_at,
        padding=-crc_at % 4,
        tail=CRLF if crlf else b"",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StimFrames:
    """The gyros' data in datagrams, unscaled: `gyro` of shape (n, 3), the temperature [°C] of the gyros (n, 3).

    `status` combines the status of the gyros and of their temperatures, shape (n,). Without temperatures in the
    datagram they are nan.
    """

    gyro: IntArray
    temperature_c: FloatArray
    status: IntArray
    counter: IntArray
    latency_us: IntArray


def decode_frames(datagram_id: int, rows: ByteArray) -> StimFrames:
    """Return the gyros' part of complete datagrams, rows of shape (n, length)."""
    layout = contents_type(datagram_id)
    frames = np.ascontiguousarray(rows[:, : layout.itemsize]).view(layout)[:, 0]
    status = frames["gyro_status"].astype(np.int64)
    temperature_c = np.full((len(rows), 3), np.nan)
    if "temperature" in PARTS[datagram_id]:
        temperature_c = frames["gyro_temperature"] * TEMPERATURE_STEP_C
        status |= frames["gyro_temperature_status"]
    return StimFrames(
        gyro=from_int24(frames["gyro"]),
        temperature_c=temperature_c,
        status=status,
        counter=frames["counter"].astype(np.int64),
        latency_us=frames["latency_us"].astype(np.int64),
    )


def encode_frames(
    datagram_id: int,
    gyro: npt.ArrayLike,
    *,
    counter: npt.ArrayLike,
    temperature_c: npt.ArrayLike = 0.0,
    status: npt.ArrayLike = 0,
    latency_us: npt.ArrayLike = 0,
    crlf: bool = False,
) -> bytes:
    """Return datagrams for gyro samples, shape (n, 3); everything else is one value for all or one per datagram.

    All temperatures are those of the gyros; the other sensors read zero.
    """
    steps = np.asarray(gyro, np.int64)
    contents = np.zeros(len(steps), contents_type(datagram_id))
    contents["id"] = datagram_id
    contents["gyro"] = to_int24(steps)
    contents["counter"] = np.asarray(counter) % COUNTERS
    contents["latency_us"] = latency_us
    warm = np.broadcast_to(np.rint(np.asarray(temperature_c) / TEMPERATURE_STEP_C), (len(steps),))
    for name in contents.dtype.names or ():
        if name.endswith("_status"):
            contents[name] = status
        elif name.endswith("_temperature"):
            contents[name] = warm[:, np.newaxis]
    as_bytes = contents.view(np.uint8).reshape(len(steps), contents.dtype.itemsize)
    return frame_format(datagram_id, crlf=crlf).sealed(as_bytes)


def from_int24(fields: ByteArray) -> IntArray:
    """Return signed numbers from three bytes each, shape (…, 3) to (…)."""
    high, middle, low = (fields[..., place].astype(np.int64) for place in range(3))
    unsigned = high << 16 | middle << 8 | low
    signed: IntArray = (unsigned ^ 0x800000) - 0x800000
    return signed


def to_int24(numbers: IntArray) -> ByteArray:
    """Return the three bytes of each number, shape (…) to (…, 3); numbers out of range are clipped."""
    fitting = np.clip(numbers, -0x800000, 0x7FFFFF)
    return np.stack([fitting >> shift & 0xFF for shift in (16, 8, 0)], axis=-1).astype(np.uint8)


def status_words(status: int) -> tuple[str, ...]:
    """Return the texts of a status, with the axes concerned."""
    axes = "".join(name for bit, name in AFFECTED_AXES.items() if status >> bit & 1)
    words = tuple(words for bit, words in STATUS_WORDS.items() if status >> bit & 1)
    if axes and not words:
        words = ("not valid",)
    return tuple(f"{word} ({axes})" if axes else word for word in words)


ASK_CONFIGURATION, ASK_SERIAL = b"C\r", b"I\r"

CONFIGURATION_FORMATS = (
    FrameFormat(name="STIM300 configuration", header=b"\xbc", crc_at=22, padding=2),
    FrameFormat(name="STIM300 configuration", header=b"\xbd", crc_at=22, padding=2, tail=CRLF),
)
SERIAL_FORMATS = (
    FrameFormat(name="STIM300 serial number", header=b"\xb5", crc_at=16),
    FrameFormat(name="STIM300 serial number", header=b"\xb7", crc_at=16, tail=CRLF),
)

RATES_HZ = (125.0, 250.0, 500.0, 1000.0, 2000.0)  # by the code; the next one is an external trigger
GYRO_UNITS = ("angular rate", "incremental angle", "average angular rate", "integrated angle")  # by the code
PART_BITS: dict[Part, int] = {"acceleration": 1, "inclination": 2, "temperature": 3, "auxiliary": 4}
CRLF_BIT = 0
SERIAL_DIGITS = 14


@dataclass(frozen=True, slots=True, kw_only=True)
class StimConfiguration:
    """The configuration of a STIM300's gyros; `rate_hz` is None if samples are triggered externally."""

    datagram_id: int
    crlf: bool
    rate_hz: float | None
    gyro_unit: str
    revision: str = "-"
    firmware: int = 0


def encode_configuration(configuration: StimConfiguration) -> bytes:
    """Return the answer to `ASK_CONFIGURATION`; everything except the gyros is 0."""
    parts = PARTS[configuration.datagram_id]
    rate = len(RATES_HZ) if configuration.rate_hz is None else RATES_HZ.index(configuration.rate_hz)
    frame = CONFIGURATION_FORMATS[configuration.crlf]
    contents = np.zeros((1, frame.crc_at), np.uint8)
    contents[0, 0] = frame.header[0]
    contents[0, 1] = ord(configuration.revision)
    contents[0, 2] = configuration.firmware
    contents[0, 3] = rate << 5 | sum(1 << PART_BITS[part] for part in parts if part in PART_BITS) | configuration.crlf
    contents[0, 5] = 0b111 << 4 | GYRO_UNITS.index(configuration.gyro_unit)
    return frame.sealed(contents)


def decode_configuration(row: ByteArray) -> StimConfiguration:
    """Parse a complete answer, shape (length,); raises `InstrumentError` for an unsupported configuration."""
    settings, unit = int(row[3]), int(row[5] & 0x0F)
    included = {part for part, bit in PART_BITS.items() if settings >> bit & 1}
    datagram_id = next(number for number, parts in PARTS.items() if set(parts) == included | {"gyro"})
    if unit >= len(GYRO_UNITS):
        raise InstrumentError(
            f"the STIM300's gyros put out unit {unit}, expected 0 to {len(GYRO_UNITS) - 1}; have it set to angular rate"
        )
    rate = settings >> 5
    return StimConfiguration(
        datagram_id=datagram_id,
        crlf=bool(settings >> CRLF_BIT & 1),
        rate_hz=RATES_HZ[rate] if rate < len(RATES_HZ) else None,
        gyro_unit=GYRO_UNITS[unit],
        revision=chr(row[1]),
        firmware=int(row[2]),
    )


def encode_serial(serial: str, *, crlf: bool = False) -> bytes:
    """Return the answer to `ASK_SERIAL`, for 14 digits."""
    frame = SERIAL_FORMATS[crlf]
    contents = frame.header + b"N" + bytes.fromhex(serial)
    padded = np.frombuffer(contents.ljust(frame.crc_at, b"\0"), np.uint8)
    return frame.sealed(padded[np.newaxis])


def decode_serial(row: ByteArray) -> str:
    """Return the 14 digits of a complete answer, shape (length,)."""
    return row[2 : 2 + SERIAL_DIGITS // 2].tobytes().hex()
