"""The measurements of a Sensonor STIM300: datagrams of three gyros, and of what else it was ordered to send.

    | id 1 | gyro | acceleration | inclination | temperature of each | auxiliary | counter 1 | latency 2 | CRC 4 |

    gyro, acceleration, inclination: | X i24 | Y i24 | Z i24 | status 1 |
    temperature of each of them:     | X i16 | Y i16 | Z i16 | status 1 |       auxiliary: | i24 | status 1 |

Numbers are big-endian; the id says which parts there are. The CRC-32/MPEG-2 covers all before it, filled up with zero
bytes, which are not sent, to a multiple of four. CR LF ends a datagram where the STIM300 is configured so. `latency` is
the time [µs] from the sample to its first byte on the wire. The host asks with one letter and CR; the answers come
between measurements: `benchctl_instruments.protocols.stim300_answers`.

Source: vortexntnu stim300-driver, stim300_constants.hpp and datagram_parser.cpp (ids, parts, padding, scales);
rock-drivers imu_stim300, stim300.hpp (layout, latency, counter). Not tried on hardware. The sources do not agree on
what the counter goes up by from one datagram to the next, so nothing here assumes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.protocols.crc32_mpeg2 import ByteArray
from benchctl_instruments.protocols.frames import FrameFormat

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
ACCELERATION_STEP_G = {2: 2.0**-21, 5: 2.0**-20, 10: 2.0**-19, 30: 2.0**-18, 80: 2.0**-16}  # by the range, ±g
INCLINATION_STEP_G = 2.0**-22
TEMPERATURE_STEP_C = 2.0**-8
AUXILIARY_STEP_V = 5.0 * 2.0**-24

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
    """The layout of a datagram up to its CRC; numbers of three bytes are fields of shape (…, 3) of bytes."""
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
    """How a datagram is found in the stream."""
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
    """What datagrams carry of the gyros, in steps: `gyro` of shape (n, 3), the temperature [°C] of the gyros (n, 3).

    `status` is that of the gyros and of their temperatures together, shape (n,). A datagram without temperatures has
    nan in their place.
    """

    gyro: IntArray
    temperature_c: FloatArray
    status: IntArray
    counter: IntArray
    latency_us: IntArray


def decode_frames(datagram_id: int, rows: ByteArray) -> StimFrames:
    """The gyros' part of whole datagrams, rows of shape (n, length)."""
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
    """Datagrams from steps of the gyros, shape (n, 3); all else is one value for all or one a datagram.

    Every part is as warm as the gyros; the other sensors state zero.
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
    """Signed numbers of three bytes, shape (…, 3) to (…)."""
    high, middle, low = (fields[..., place].astype(np.int64) for place in range(3))
    unsigned = high << 16 | middle << 8 | low
    signed: IntArray = (unsigned ^ 0x800000) - 0x800000
    return signed


def to_int24(numbers: IntArray) -> ByteArray:
    """Three bytes of each number, shape (…) to (…, 3); what does not fit is stated as the nearest that does."""
    fitting = np.clip(numbers, -0x800000, 0x7FFFFF)
    return np.stack([fitting >> shift & 0xFF for shift in (16, 8, 0)], axis=-1).astype(np.uint8)


def status_words(status: int) -> tuple[str, ...]:
    """What a status says, with the axes it names."""
    axes = "".join(name for bit, name in AFFECTED_AXES.items() if status >> bit & 1)
    words = tuple(words for bit, words in STATUS_WORDS.items() if status >> bit & 1)
    if axes and not words:
        words = ("not valid",)
    return tuple(f"{word} ({axes})" if axes else word for word in words)
