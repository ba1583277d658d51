"""The frames of a KVH DSP-1760 fibre-optic gyro (format A of KVH's 1725, 1750 and 1760), and its settings.

    | FE 81 FF 55 | rotation X, Y, Z: 3 x f32 | acceleration X, Y, Z: 3 x f32 | status 1 | sequence 1 |
    | temperature i16 | CRC-32/MPEG-2 of all before |                   36 bytes, big-endian, RS-422, 8N1

Rotation is a rate, or the angle since the previous frame, in degrees or radians depending on the settings; acceleration
is unused in the DSP-1760. A bit of `status` is 1 if its channel is valid. The sequence number runs 0 ... 127.

    host "=NAME,VALUE" CR LF  ->  gyro "NAME,VALUE" in a separate line, "INVALID,..." if it has no such setting
    host "?NAME" CR LF        ->  gyro "NAME,VALUE"

`config,1` permits changes and queries of settings, `config,0` starts the frames again. Sources differ on whether
`config,0` is echoed: according to KVH's manual of the 1775 commands are echoed, according to a public driver for the
1750 this one is not. Accept the echo or the first valid frame. Names are accepted in upper or lower case.

Source: ESA-PRL drivers-dsp1760, dsp1760.cpp (frame, settings, temperature in 0.01 °C); TRECVT ros_kvh1750, imu.cpp and
kvhmessage.h (frame, CRC, rates, queries, no confirmation of `config,0`); KVH 1775 manual p. 57 (echo, INVALID). Not
tried on hardware. Assumptions without a source: no frames are sent while settings can be changed; INVALID repeats the
command; a command outside `config,1` is not answered.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.protocols.frames import ByteArray, FrameFormat, FrameReader

HEADER = bytes.fromhex("FE 81 FF 55")
FORMAT = FrameFormat(name="KVH format A", header=HEADER, crc_at=32)
SEQUENCE_NUMBERS = 128
DEFAULT_BAUD = 921_600
RATES_HZ = (1, 5, 10, 25, 50, 100, 250, 500, 750, 1000)
"""The data rates of the 1750 and the 1760; there are no others."""

CHANNELS = {  # by the bit of the status
    0: "gyro X",
    1: "gyro Y",
    2: "gyro Z",
    4: "accelerometer X",
    5: "accelerometer Y",
    6: "accelerometer Z",
}
GYROS_VALID = 0b111

CONTENTS = np.dtype(
    [
        ("header", "V4"),
        ("rotation", ">f4", (3,)),
        ("acceleration", ">f4", (3,)),
        ("status", "u1"),
        ("sequence", "u1"),
        ("temperature", ">i2"),
    ]
)
_FRAME = np.dtype([*CONTENTS.descr, ("crc", ">u4")])

ROTATION_DEGREES = {"deg": 1.0, "rad": math.degrees(1.0)}
TEMPERATURE_STEP_C = {"c": 1.0, "c_100": 0.01}


@dataclass(frozen=True, slots=True, kw_only=True)
class KvhFrames:
    """Contents of frames, unscaled: rotation of shape (n, 3), everything else of shape (n,)."""

    rotation: FloatArray
    temperature: IntArray
    status: IntArray
    sequence: IntArray


def encode_frames(
    rotation: npt.ArrayLike, temperature: npt.ArrayLike, *, first_sequence: int, status: npt.ArrayLike = GYROS_VALID
) -> bytes:
    """Return frames for rotation of shape (n, 3); temperature and status are one value for all or one per frame."""
    turned = np.asarray(rotation, np.float64)
    contents = np.zeros(len(turned), CONTENTS)
    contents["header"] = np.void(HEADER)
    contents["rotation"] = turned
    contents["status"] = status
    contents["sequence"] = (first_sequence + np.arange(len(turned))) % SEQUENCE_NUMBERS
    contents["temperature"] = temperature
    return FORMAT.sealed(contents.view(np.uint8).reshape(len(turned), CONTENTS.itemsize))


def decode_frames(rows: ByteArray) -> KvhFrames:
    """Return the contents of complete frames, rows of shape (n, 36)."""
    frames = np.ascontiguousarray(rows).view(_FRAME)[:, 0]
    return KvhFrames(
        rotation=frames["rotation"].astype(np.float64),
        temperature=frames["temperature"].astype(np.int64),
        status=frames["status"].astype(np.int64),
        sequence=frames["sequence"].astype(np.int64),
    )


def status_words(status: int, channels: int = GYROS_VALID) -> tuple[str, ...]:
    """Return texts for the invalid ones of some channels, given as bits of the status."""
    return tuple(
        f"{name} is not valid" for bit, name in CHANNELS.items() if channels >> bit & 1 and not status >> bit & 1
    )


def encode_setting(name: str, value: str | int) -> bytes:
    """Return the bytes that the host sends to change a setting."""
    return f"={name},{value}\r\n".encode("ascii")


def encode_answer(*parts: str | int) -> bytes:
    """Return a line of the gyro: name and value of a setting, or INVALID and the command."""
    return (",".join(str(part) for part in parts) + "\r\n").upper().encode("ascii")


def after_echo(data: bytes, name: str, value: str | int) -> bytes | None:
    """Return the bytes after the answer to a setting, which is between frames; None if it has not arrived."""
    line = re.search(re.escape(encode_answer(name, value).rstrip()) + rb"[\r\n]+", data.upper())
    return data[line.end() :] if line else None


def after_leaving(data: bytes) -> bytes | None:
    """Return the stream after `config,0`: after the echo, or from the first valid frame on; None if neither arrived."""
    if (rest := after_echo(data, "config", 0)) is not None:
        return rest
    runs = FrameReader([FORMAT]).feed(data)
    return data[int(runs[0].first_byte[0]) :] if runs else None


def refusal_in(data: bytes) -> str:
    """Return the line in which the gyro refuses a command; empty if there is none."""
    line = re.search(rb"INVALID[ -~]*(?=[\r\n])", data.upper())
    return line[0].decode("ascii") if line else ""


@dataclass(frozen=True, slots=True)
class Kvh1760Command:
    """A command of the host, in lower case: `?` queries a setting, `=` changes it; `value` may be empty."""

    sign: str
    name: str
    value: str = ""


class CommandReader:
    """Extract commands from the bytes that the gyro receives, cut anywhere; invalid lines are ignored.

    A command is at the end of its line: the driver of ESA-PRL sends buffers of fixed length; the undefined bytes after
    the line's end precede its next command.
    """

    def __init__(self) -> None:
        self._line = b""

    def feed(self, data: bytes) -> list[Kvh1760Command]:
        """Add received bytes and return the commands that they complete."""
        *lines, self._line = (self._line + data).split(b"\n")
        self._line = self._line[-256:]
        found = (re.search(rb"([=?])([a-z]+)(?:,([!-~]*))?\Z", line.strip().lower()) for line in lines)
        return [Kvh1760Command(*(part.decode("ascii") for part in one.groups(b""))) for one in found if one]
