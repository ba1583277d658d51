"""KVH DSP-1760: a fibre-optic gyro of one to three axes on RS-422.

Not tried on hardware. Settings and frame: `protocols.kvh1760`. The gyro answers every setting, so the line to the gyro
must also be connected; the command that starts the frames may be answered by the first frame. While no stream runs, the
gyro is left in the mode in which it accepts settings and sends no frames. Its number wraps after 128 samples: at
1000 Hz, a line that was unread for more than 0.1 s leaves a gap of unknown length.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from benchctl_instruments.errors import InstrumentError, UsageError
from benchctl_instruments.gyros.framed_gyro import FramedGyro, SampleQueue, Samples
from benchctl_instruments.interfaces import Identity
from benchctl_instruments.protocols import kvh1760 as kvh
from benchctl_instruments.protocols.frames import ByteArray, FrameReader, SequenceNumbers
from benchctl_instruments.protocols.lines import MOST_SHOWN
from benchctl_instruments.recognition import ByFrames, ByLine

ROTATION_UNIT, TEMPERATURE_UNIT = "deg", "c_100"


def _frames_in(data: bytes) -> str:
    """Describe the frames in some bytes; empty if there are none."""
    reader = FrameReader([kvh.FORMAT])
    reader.feed(data)
    return f"{reader.kept} frames of KVH's format A (also 1725, 1750, 1775)" if reader.kept else ""


def _recognised(line: str) -> str:
    """Describe the gyro from the answer to `?dr`, which it only gives while its settings may be changed."""
    name, _, rate_hz = line.partition(",")
    if name.upper() != "DR" or not rate_hz.isdecimal():
        raise InstrumentError(f"expected DR and a rate, got {line[:MOST_SHOWN]!r}")
    return f"KVH, accepting settings; set to {rate_hz} Hz"


class KvhDsp1760(FramedGyro):
    """A DSP-1760; implements `benchctl_instruments.interfaces.Gyro`. Parameters: see `FramedGyro`.

    Of the other axes the faults are reported too.
    """

    NAME, DEFAULT_BAUD = "KVH DSP-1760", kvh.DEFAULT_BAUD
    RATES_HZ = kvh.RATES_HZ
    recognition = (
        ByFrames(baud=kvh.DEFAULT_BAUD, find=_frames_in),
        ByLine(query="?dr", read=_recognised, baud=kvh.DEFAULT_BAUD),
    )

    def _check(self) -> None:
        self._set("config", 1)
        self._identity = Identity(manufacturer="KVH", model="DSP-1760")

    def _begin(self, rate_hz: float) -> tuple[float, SampleQueue, bytes]:
        if rate_hz not in kvh.RATES_HZ:
            known = ", ".join(str(rate) for rate in kvh.RATES_HZ)
            raise UsageError(f"{self._who}: a rate of {rate_hz:g} Hz; give one that a KVH DSP-1760 has: {known} Hz")
        self._set("config", 1)
        self._set("rotfmt", "rate")
        self._set("rotunits", ROTATION_UNIT)
        self._set("tempunits", TEMPERATURE_UNIT)
        self._set("dr", int(rate_hz))
        come = self._ask(kvh.encode_setting("config", 0), kvh.after_leaving, "its echo or a frame")
        words = partial(kvh.status_words, channels=1 << self._axis)
        numbers = SequenceNumbers(kvh.SEQUENCE_NUMBERS)
        return rate_hz, SampleQueue(kvh.FORMAT, numbers, decode=self._decode, words=words, rate_hz=rate_hz), come

    def _end(self) -> None:
        self._set("config", 1)

    def _set(self, name: str, value: str | int) -> None:
        """Change a setting; raises `InstrumentError` if the gyro refuses it."""

        def answer(heard: bytes) -> bytes | None:
            if refusal := kvh.refusal_in(heard):
                raise InstrumentError(
                    f"{self._who}: sent {kvh.encode_setting(name, value)!r}, it answered {refusal!r}; check the model"
                )
            return kvh.after_echo(heard, name, value)

        self._ask(kvh.encode_setting(name, value), answer, f"the answer {kvh.encode_answer(name, value)!r}")

    def _decode(self, rows: ByteArray) -> Samples:
        frames = kvh.decode_frames(rows)
        rates_dps = frames.rotation * kvh.ROTATION_DEGREES[ROTATION_UNIT]
        valid = (frames.status[:, np.newaxis] >> np.arange(3) & 1).astype(bool)
        return Samples(
            number=frames.sequence,
            rate_dps=rates_dps[:, self._axis],
            rates_dps=np.where(valid, rates_dps, np.nan),
            temperature_c=frames.temperature.astype(np.float64) * kvh.TEMPERATURE_STEP_C[TEMPERATURE_UNIT],
            status=frames.status,
            valid=valid[:, self._axis],
        )


Driver = KvhDsp1760
