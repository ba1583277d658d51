"""The frames of a KVH DSP-1760 fibre-optic gyro (format A of KVH's 1725, 1750 and 1760), and its settings.

    | FE 81 FF 55 | rotation X, Y, Z: 3 x f32 | acceleration X, Y, Z: 3 x f32 | status 1 | sequence 1 |
    | temperature i16 | CRC-32/MPEG-2 of all before |                   36 bytes, big-endian, RS-422, 8N1

Rotation is a rate, or the angle turned since the frame before, in degrees or radians as it was set; acceleration is
unused in the DSP-1760. A bit of `status` is 1 where its channel is valid. The sequence number runs 0 ... 127.

    host "=NAME,VALUE" CR LF  ->  gyro "NAME,VALUE" in a line of its own, "INVALID,..." where it has no such setting
    host "?NAME" CR LF        ->  gyro "NAME,VALUE"

`config,1` lets settings be changed and asked for, `config,0` starts the frames again. Whether `config,0` is echoed is
not agreed: KVH's manual of the 1775 says that commands are, a public driver for the 1750 says that this one is not.
Take the echo or the first good frame. Names are known as either upper or lower case.

Source: ESA-PRL drivers-dsp1760, dsp1760.cpp (frame, settings, temperature in 0.01 °C); TRECVT ros_kvh1750, imu.cpp and
kvhmessage.h (frame, CRC, rates, queries, no confirmation of `config,0`); KVH 1775 manual p. 57 (echo, INVALID). Not
tried on hardware. Assumed where the sources are silent: no frames come while settings can be changed; INVALID repeats
the command; a command outside of `config,1` is not answered.
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
"""The data rates of the 1750 and the 1760; they have no others."""

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
    """What frames carry, as they carry it: rotation of shape (n, 3), all else of shape (n,)."""

    rotation: FloatArray
    temperature: IntArray
    status: IntArray
    sequence: IntArray


def encode_frames(
    rotation: npt.ArrayLike, temperature: npt.ArrayLike, *, first_sequence: int, status: npt.ArrayLike = GYROS_VALID
) -> bytes:
    """Frames from rotation of shape (n, 3); temperature and status are one value for all or one a frame."""
    turned = np.asarray(rotation, np.float64)
    contents = np.zeros(len(turned), CONTENTS)
    contents["header"] = np.void(HEADER)
    contents["rotation"] = turned
    contents["status"] = status
    contents["sequence"] = (first_sequence + np.arange(len(turned))) % SEQUENCE_NUMBERS
    contents["temperature"] = temperature
    return FORMAT.sealed(contents.view(np.uint8).reshape(len(turned), CONTENTS.itemsize))


def decode_frames(rows: ByteArray) -> KvhFrames:
    """What whole frames, rows of shape (n, 36), carry."""
    frames = np.ascontiguousarray(rows).view(_FRAME)[:, 0]
    return KvhFrames(
        rotation=frames["rotation"].astype(np.float64),
        temperature=frames["temperature"].astype(np.int64),
        status=frames["status"].astype(np.int64),
        sequence=frames["sequence"].astype(np.int64),
    )


def status_words(status: int, channels: int = GYROS_VALID) -> tuple[str, ...]:
    """Which of some channels, given as bits of the status, are not valid."""
    return tuple(
        f"{name} is not valid" for bit, name in CHANNELS.items() if channels >> bit & 1 and not status >> bit & 1
    )


def encode_setting(name: str, value: str | int) -> bytes:
    """What the host sends to change a setting."""
    return f"={name},{value}\r\n".encode("ascii")


def encode_answer(*parts: str | int) -> bytes:
    """A line of the gyro: name and value of a setting, or INVALID and the command."""
    return (",".join(str(part) for part in parts) + "\r\n").upper().encode("ascii")


def after_echo(data: bytes, name: str, value: str | int) -> bytes | None:
    """What came after the answer to a setting, which stands between frames; None where the answer has not come."""
    line = re.search(re.escape(encode_answer(name, value).rstrip()) + rb"[\r\n]+", data.upper())
    return data[line.end() :] if line else None


def after_leaving(data: bytes) -> bytes | None:
    """The stream after `config,0`: what follows the echo, or from the first good frame on; None: neither has come."""
    if (rest := after_echo(data, "config", 0)) is not None:
        return rest
    runs = FrameReader([FORMAT]).feed(data)
    return data[int(runs[0].first_byte[0]) :] if runs else None


def refusal_in(data: bytes) -> str:
    """The line in which the gyro refuses a command; empty where there is none."""
    line = re.search(rb"INVALID[ -~]*(?=[\r\n])", data.upper())
    return line[0].decode("ascii") if line else ""


@dataclass(frozen=True, slots=True)
class Kvh1760Command:
    """What the host says, in lower case: `?` asks for a setting, `=` changes it; `value` may be empty."""

    sign: str
    name: str
    value: str = ""


class CommandReader:
    """Commands out of what the gyro hears, bytes cut anywhere; a line that is no command is passed over.

    A command stands at the end of its line: the driver of ESA-PRL sends buffers of fixed length, whose rest, behind the
    line's end, is not defined and comes before its next command.
    """

    def __init__(self) -> None:
        self._line = b""

    def feed(self, data: bytes) -> list[Kvh1760Command]:
        """The commands that are complete with these bytes."""
        *lines, self._line = (self._line + data).split(b"\n")
        self._line = self._line[-256:]
        found = (re.search(rb"([=?])([a-z]+)(?:,([!-~]*))?\Z", line.strip().lower()) for line in lines)
        return [Kvh1760Command(*(part.decode("ascii") for part in one.groups(b""))) for one in found if one]
