"""What a STIM300 says of itself when the host asks: how it is configured, and its serial number.

    host "C" CR  ->  | BC, or BD with CR LF | 21 bytes, see below | CRC 4 | CR LF |
    host "I" CR  ->  | B5, or B7 with CR LF | "N" | 14 digits, two a byte | 7 reserved | CRC 4 | CR LF |

    | revision 1 | firmware 1 | rate 3 bits, auxiliary, temperature, inclination, acceleration, CR LF a bit each |
    | line 1 | gyro axes 4 bits, gyro unit 4 bits | 16 more, of filters and of the other sensors |

Source: vortexntnu stim300-driver, datagram_parser.cpp and driver_stim300.cpp (configuration); cookednoodle pystim300,
datagrams.py and client.py (serial number, the letter that asks for it). Not tried on hardware. Units of the gyro beyond
the first four are read differently by the sources, so they are refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.protocols.crc32_mpeg2 import ByteArray
from benchctl_instruments.protocols.frames import FrameFormat
from benchctl_instruments.protocols.stim300 import CRLF, PARTS, Part

ASK_CONFIGURATION, ASK_SERIAL = b"C\r", b"I\r"

CONFIGURATION_FORMATS = (
    FrameFormat(name="STIM300 configuration", header=b"\xbc", crc_at=22, padding=2),
    FrameFormat(name="STIM300 configuration", header=b"\xbd", crc_at=22, padding=2, tail=CRLF),
)
SERIAL_FORMATS = (
    FrameFormat(name="STIM300 serial number", header=b"\xb5", crc_at=16),
    FrameFormat(name="STIM300 serial number", header=b"\xb7", crc_at=16, tail=CRLF),
)

RATES_HZ = (125.0, 250.0, 500.0, 1000.0, 2000.0)  # by the code; what follows is an external trigger
GYRO_UNITS = ("angular rate", "incremental angle", "average angular rate", "integrated angle")  # by the code
PART_BITS: dict[Part, int] = {"acceleration": 1, "inclination": 2, "temperature": 3, "auxiliary": 4}
CRLF_BIT = 0
SERIAL_DIGITS = 14


@dataclass(frozen=True, slots=True, kw_only=True)
class StimConfiguration:
    """How a STIM300 is set up, as far as its gyros go; `rate_hz` is None where samples are triggered from outside."""

    datagram_id: int
    crlf: bool
    rate_hz: float | None
    gyro_unit: str
    revision: str = "-"
    firmware: int = 0


def encode_configuration(configuration: StimConfiguration) -> bytes:
    """The answer to `ASK_CONFIGURATION`; what is not of the gyros is stated as 0."""
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
    """From a whole answer, shape (length,); `InstrumentError` for what this project cannot read."""
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
    """The answer to `ASK_SERIAL`, for 14 digits."""
    frame = SERIAL_FORMATS[crlf]
    contents = frame.header + b"N" + bytes.fromhex(serial)
    padded = np.frombuffer(contents.ljust(frame.crc_at, b"\0"), np.uint8)
    return frame.sealed(padded[np.newaxis])


def decode_serial(row: ByteArray) -> str:
    """The 14 digits of a whole answer, shape (length,)."""
    return row[2 : 2 + SERIAL_DIGITS // 2].tobytes().hex()
