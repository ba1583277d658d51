"""Sensonor STIM300: three gyros, and other sensors as ordered, on RS-422.

Not tried on hardware. Datagrams and answers: `protocols.stim300`. The driver changes no setting: it reads the
configuration of the STIM300 and follows it. The STIM300 sends continuously, so a stream begins after the answer to a
question, and stopping a stream only stops reading.

Sources differ on the increment of the counter, so the driver determines it from the first consecutive datagrams.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from typing import TypeAlias

import numpy as np

from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.gyros.framed_gyro import LARGEST_RECEIVE, FramedGyro, SampleQueue, Samples
from benchctl_instruments.interfaces import Identity
from benchctl_instruments.protocols import stim300 as stim
from benchctl_instruments.protocols.frames import ByteArray, FrameFormat, FrameReader, SequenceNumbers, commonest_step
from benchctl_instruments.protocols.stim300 import StimConfiguration
from benchctl_instruments.recognition import ByFrames

FIRST_DATAGRAMS = 9
READABLE = ("angular rate", "average angular rate", "incremental angle")

Found: TypeAlias = tuple[ByteArray, bytes]
"""A complete answer and the bytes after it."""


def _datagrams_in(data: bytes) -> str:
    """Describe the datagrams in some bytes; empty if there are none."""
    reader = FrameReader([stim.frame_format(datagram) for datagram in stim.PARTS])
    runs = reader.feed(data)
    return f"{reader.kept} of Sensonor's datagrams {runs[0].rows[0, 0]:02X}h" if runs else ""


class SensonorStim300(FramedGyro):
    """A STIM300; implements `benchctl_instruments.interfaces.Gyro`. Parameters: see `FramedGyro`."""

    NAME, DEFAULT_BAUD = "Sensonor STIM300", stim.DEFAULT_BAUD
    recognition = (ByFrames(baud=stim.DEFAULT_BAUD, find=_datagrams_in),)

    def _check(self) -> None:
        configuration, _ = self._configuration()
        serial, _ = self._answer(stim.ASK_SERIAL, stim.SERIAL_FORMATS)
        self._identity = Identity(
            manufacturer="Sensonor",
            model="STIM300",
            serial=stim.decode_serial(serial),
            firmware=f"{configuration.revision}{configuration.firmware}",
        )

    def _begin(self, rate_hz: float) -> tuple[float, SampleQueue, bytes]:
        configuration, come = self._configuration()
        actual_hz = self._check_readable(configuration, rate_hz)
        datagram = stim.frame_format(configuration.datagram_id, crlf=configuration.crlf)
        self._clock.sleep((FIRST_DATAGRAMS + 1) / actual_hz)
        come, step = self._counter_step(configuration, datagram, come)
        incremental = configuration.gyro_unit == "incremental angle"
        step_dps = stim.ANGLE_STEP_DEG * actual_hz if incremental else stim.RATE_STEP_DPS
        queue = SampleQueue(
            datagram,
            SequenceNumbers(stim.COUNTERS, step=step),
            decode=partial(self._decode, configuration.datagram_id, step_dps),
            words=stim.status_words,
            rate_hz=actual_hz,
        )
        return actual_hz, queue, come

    def _check_readable(self, configuration: StimConfiguration, rate_hz: float) -> float:
        """Return the rate at which it sends; raises if that is not the wanted one or the axis cannot be read."""
        if configuration.rate_hz is None:
            raise InstrumentError(
                f"{self._who}: it samples at an external trigger, so its counter is not a clock;"
                " have it set to a rate of its own"
            )
        if configuration.rate_hz != rate_hz:
            raise InstrumentError(
                f"{self._who}: {rate_hz:g} samples a second were asked for, it is set to {configuration.rate_hz:g};"
                " ask for that, or change it in its service mode"
            )
        if configuration.gyro_unit not in READABLE:
            raise InstrumentError(
                f"{self._who}: its gyros put out {configuration.gyro_unit}, expected one of {', '.join(READABLE)};"
                " change it in its service mode"
            )
        return configuration.rate_hz

    def _counter_step(self, configuration: StimConfiguration, datagram: FrameFormat, come: bytes) -> tuple[bytes, int]:
        """Wait for some datagrams; return all received bytes and the increment of the counter."""
        give_up_s = time.monotonic() + self._timeout_s
        reader = FrameReader([datagram])
        runs = reader.feed(come)
        while reader.kept < FIRST_DATAGRAMS:
            try:
                data = self._link.receive(LARGEST_RECEIVE, self._left_s(give_up_s))
            except LinkError as err:
                raise LinkError(
                    f"{self._who}: expected {FIRST_DATAGRAMS} datagrams {datagram.name[-3:]} as it is configured,"
                    f" {reader.kept} came and {reader.junk_bytes} bytes that are none:"
                    f" {self._link.address.left_out(err)}; check its baud"
                ) from err
            come += data
            runs += reader.feed(data)
        rows = np.concatenate([run.rows for run in runs])
        return come, commonest_step(stim.decode_frames(configuration.datagram_id, rows).counter, stim.COUNTERS)

    def _configuration(self) -> tuple[StimConfiguration, bytes]:
        row, rest = self._answer(stim.ASK_CONFIGURATION, stim.CONFIGURATION_FORMATS)
        try:
            return stim.decode_configuration(row), rest
        except InstrumentError as err:
            raise InstrumentError(f"{self._who}: {err}") from err

    def _answer(self, question: bytes, formats: Sequence[FrameFormat]) -> Found:
        def find(heard: bytes) -> Found | None:
            for kind in formats:  # each alone: the header of a longer one just before the answer would wait for more
                for run in FrameReader([kind]).feed(heard):
                    return run.rows[0], heard[int(run.first_byte[0]) + kind.length :]
            return None

        return self._ask(question, find, f"a datagram {formats[0].name}")

    def _decode(self, datagram_id: int, step_dps: float, rows: ByteArray) -> Samples:
        frames = stim.decode_frames(datagram_id, rows)
        rates_dps = frames.gyro.astype(np.float64) * step_dps
        valid = frames.status == 0
        return Samples(
            number=frames.counter,
            rate_dps=rates_dps[:, self._axis],
            rates_dps=np.where(valid[:, np.newaxis], rates_dps, np.nan),
            temperature_c=frames.temperature_c[:, self._axis],
            status=frames.status,
            valid=valid,
        )


Driver = SensonorStim300
