"""A digital gyro on the simulated bench, which sends samples: three axes, or one analog gyro with a converter.

If the bench's settings have `three_axes`, it is the unit of `physics.three_axes`. Otherwise it is

    rate = (U - U0) / K0,    temperature = (thermistor volts - offset) / slope

so its rate is that of the simulated sensor, with all its physics and noise, scaled with the factory values at T0 and
rounded for its frames; the other two axes state 0. Not modelled: compensation inside the gyro, so it has the errors of
an analog one; its own filters; its own clock, except by the effects of time stamps. On a complete bench it is a second
gyro of the same make in addition to the analog one (`World.second_gyro`): both turn with one table and warm up in one
chamber, and each has its own noise.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.mounting import AXES
from benchctl_instruments.simulated.machines import GyroInputs
from benchctl_instruments.simulated.push_line import PushLine
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.tcp_server import Startable

BITS_PER_BYTE = 10  # 8N1
LARGEST_BATCH = 4096  # frames that are created at once
LONGEST_LATE_S = 10.0  # of bench time: a line holds no more of them; twice the longest wait of a run that reads
ROUNDING = 1e-6  # in sample intervals: the delay after its instant at which a frame counts as due


class DigitalGyro(Startable, ABC):
    """A gyro at `address` that sends frames, from `start()` to `stop()`, or in a `with`.

    A frame is due when a line of `baud` would have carried its last byte. Its instants are equidistant on the bench's
    clock; late frames are sent late. Frames that the line does not accept are lost. If the clock jumps by more than
    10 s, as in a soak without a reader, the older frames are lost, too.

    Parameters
    ----------
    inputs
        The sensor's output.
    settings
        The settings of the bench of `inputs`.
    axis
        "x", "y" or "z": the axis along the table's, unless it is turned.
    baud
        The line's speed.
    over_tcp
        Serial over TCP instead of a pseudo-terminal.

    Attributes
    ----------
    line
        The line that carries the frames; it counts dropped frames, and can be disturbed.
    sent
        Number of frames created.
    batch_s
        Bench times [s] at which the latest frames of `due` were sampled, shape (n,).
    """

    frame_bytes: int

    def __init__(self, inputs: GyroInputs, settings: WorldSettings, *, axis: str, baud: int, over_tcp: bool) -> None:
        if axis not in AXES:
            raise UsageError(f"axis {axis!r}: a simulated gyro has x, y and z")
        self._axis, self._has_three = axis, settings.three_axes is not None
        sensor = settings.response or settings.gyro
        self._K0_v_per_dps, self._U0_v = sensor.K0_v_per_dps, sensor.U0_v
        self._slope_v_per_c, self._offset_v = settings.thermistor_v_per_c, settings.thermistor_offset_v
        self._inputs = inputs
        self._baud = baud
        self._first_s = math.nan  # of the stream; nan while none runs
        self._rate_hz = math.nan
        self._made = 0  # in this stream
        self.sent = 0
        self.batch_s: FloatArray = np.empty(0)
        self.line = PushLine(self, baud=baud, over_tcp=over_tcp)

    @property
    def address(self) -> str:
        """Its address, known after `start`."""
        return self.line.address

    def start(self) -> None:
        """Switch it on; when it returns, a driver can connect."""
        self.line.start()

    def stop(self) -> None:
        """Switch it off; safe to call twice."""
        self.line.stop()
        self._end_stream()

    @abstractmethod
    def feed(self, data: bytes) -> bytes:
        """Process received bytes, and return the answers to complete commands."""

    @abstractmethod
    def _skip(self, frames: int) -> None:
        """Count frames that are not created."""

    @abstractmethod
    def _frames(self, rates_dps: FloatArray, temperature_c: FloatArray) -> bytes:
        """Return frames for rates about x, y and z, shape (n, 3), and temperatures, shape (n,)."""

    def due(self) -> bytes:
        """Return the frames that are due, at most a batch."""
        late = self._late
        if late < 1:
            return b""
        if (lost := late - math.ceil(LONGEST_LATE_S * self._rate_hz)) > 0:
            self._skip(lost)
            self._made += lost
            late -= lost
        samples = min(late, LARGEST_BATCH)
        interval_s = 1.0 / self._rate_hz
        rates_dps, temperature_c = self._sampled(interval_s, samples)
        self.batch_s = self._first_s + np.arange(self._made, self._made + samples, dtype=np.float64) * interval_s
        self._made += samples
        self.sent += samples
        self._inputs.hold_history(self._first_s + self._made * interval_s)
        return self._frames(rates_dps, temperature_c)

    def _sampled(self, interval_s: float, samples: int) -> tuple[FloatArray, FloatArray]:
        """Return the next rates, shape (n, 3), and temperatures, shape (n,)."""
        if self._has_three:
            return self._inputs.sample_axes(self._axis, self._first_s, interval_s, samples, start=self._made)
        _, gyro_v, thermistor_v = self._inputs.sample(self._first_s, interval_s, samples, start=self._made)
        rates_dps = np.zeros((samples, 3))
        rates_dps[:, AXES.index(self._axis)] = (gyro_v - self._U0_v) / self._K0_v_per_dps
        return rates_dps, (thermistor_v - self._offset_v) / self._slope_v_per_c

    def lose(self) -> None:
        """Discard all frames that are due while no client is connected."""
        if (late := self._late) > 0:
            self._skip(late)
            self._made += late
            self._inputs.hold_history(self._first_s + self._made / self._rate_hz)

    def wait(self, timeout_s: float) -> bool:
        """Wait for the next frame; return False at once while no stream runs."""
        if math.isnan(self._first_s):
            return False
        next_s = self._first_s + (self._made + 2.0 * ROUNDING) / self._rate_hz + self._wire_s
        self._inputs.wait_until(next_s, timeout_s)
        return True

    @property
    def _late(self) -> int:
        """Number of frames that are due and not created yet."""
        if math.isnan(self._first_s):
            return 0
        late_s = self._inputs.now() - self._first_s - self._wire_s
        return math.floor(late_s * self._rate_hz - ROUNDING) + 1 - self._made

    @property
    def _wire_s(self) -> float:
        return self.frame_bytes * BITS_PER_BYTE / self._baud

    def _refuse_rate(self, rate_hz: float) -> None:
        if not 0.0 < rate_hz * self._wire_s <= 1.0:
            raise UsageError(
                f"{rate_hz:g} frames of {self.frame_bytes} bytes a second do not fit through {self._baud} baud:"
                f" at most {1.0 / self._wire_s:.0f} do"
            )

    def _begin_stream(self, rate_hz: float) -> None:
        self._refuse_rate(rate_hz)
        self._first_s, self._rate_hz, self._made = self._inputs.now(), rate_hz, 0
        self._inputs.hold_history(self._first_s)

    def _end_stream(self) -> None:
        self._first_s = math.nan
        self._inputs.hold_history(None)
