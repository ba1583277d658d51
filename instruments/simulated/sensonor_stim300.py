"""A simulated Sensonor STIM300. It shares only the protocol with the driver."""

from __future__ import annotations

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.protocols import stim300 as stim
from benchctl_instruments.protocols.stim300 import StimConfiguration
from benchctl_instruments.simulated.digital_gyro import DigitalGyro
from benchctl_instruments.simulated.machines import GyroInputs
from benchctl_instruments.simulated.settings import WorldSettings

RANGE_DPS = 400.0
OVERLOAD = 1 << 4
LATENCY_US = 500
GYRO_UNITS = ("angular rate", "average angular rate", "incremental angle")


class SimulatedStim300(DigitalGyro):
    """A STIM300 with one axis along the table's; it sends continuously. It has no service mode.

    Parameters
    ----------
    inputs, settings, axis, baud, over_tcp
        See `DigitalGyro`.
    rate_hz
        125, 250, 500, 1000 or 2000, if the line can carry it.
    datagram_id
        The datagram: `benchctl_instruments.protocols.stim300.PARTS`.
    crlf
        Whether CR LF ends a datagram.
    gyro_unit
        "angular rate", "average angular rate" or "incremental angle"; the first two are equal here.
    counter_step
        The increment of the counter from one datagram to the next.
    serial
        14 digits.

    Attributes
    ----------
    status
        The status of every part of a datagram, in addition to an overload; may be assigned.
    """

    def __init__(
        self,
        inputs: GyroInputs,
        settings: WorldSettings | None = None,
        *,
        rate_hz: float = 1000.0,
        datagram_id: int = 0xA7,
        crlf: bool = False,
        gyro_unit: str = "angular rate",
        counter_step: int = 1,
        axis: str = "z",
        serial: str = "25582112345678",
        baud: int = stim.DEFAULT_BAUD,
        over_tcp: bool = False,
    ) -> None:
        for name, value, known in (
            ("rate_hz", rate_hz, stim.RATES_HZ),
            ("datagram_id", datagram_id, tuple(stim.PARTS)),
            ("gyro_unit", gyro_unit, GYRO_UNITS),
        ):
            if value not in known:
                raise UsageError(f"{name} {value!r}: a simulated STIM300 has one of {', '.join(map(str, known))}")
        self.frame_bytes = stim.frame_format(datagram_id, crlf=crlf).length
        super().__init__(inputs, settings or WorldSettings(), axis=axis, baud=baud, over_tcp=over_tcp)
        self._refuse_rate(rate_hz)
        self.status = 0
        self._configuration = StimConfiguration(
            datagram_id=datagram_id, crlf=crlf, rate_hz=rate_hz, gyro_unit=gyro_unit, revision="F", firmware=31
        )
        self._serial = serial
        self._counter, self._counter_step = 0, counter_step
        self._heard = b""

    def start(self) -> None:
        """Switch it on; it sends from the beginning."""
        self._begin_stream(self._configuration.rate_hz or 0.0)
        super().start()

    def feed(self, data: bytes) -> bytes:
        """Answer the questions."""
        *questions, self._heard = (self._heard + data).split(b"\r")
        self._heard = self._heard[-len(stim.ASK_SERIAL) :]
        return b"".join(self._answer(question + b"\r") for question in questions)

    def _answer(self, question: bytes) -> bytes:
        if question == stim.ASK_CONFIGURATION:
            return stim.encode_configuration(self._configuration)
        if question == stim.ASK_SERIAL:
            return stim.encode_serial(self._serial, crlf=self._configuration.crlf)
        return b""

    def _skip(self, frames: int) -> None:
        self._counter += self._counter_step * frames

    def _frames(self, rates_dps: FloatArray, temperature_c: FloatArray) -> bytes:
        overloaded = (np.abs(rates_dps) > RANGE_DPS) @ (1 << np.arange(3))
        measured_dps = np.clip(rates_dps, -RANGE_DPS, RANGE_DPS)
        if self._configuration.gyro_unit == "incremental angle":
            steps = measured_dps / self._rate_hz / stim.ANGLE_STEP_DEG
        else:
            steps = measured_dps / stim.RATE_STEP_DPS
        counter = self._counter + self._counter_step * np.arange(len(rates_dps))
        self._counter += self._counter_step * len(rates_dps)
        return stim.encode_frames(
            self._configuration.datagram_id,
            np.rint(steps),
            counter=counter,
            temperature_c=temperature_c,
            status=np.where(overloaded, self.status | OVERLOAD | overloaded, self.status),
            latency_us=LATENCY_US,
            crlf=self._configuration.crlf,
        )


Twin = SimulatedStim300
