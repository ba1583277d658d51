"""A digital gyro on the simulated bench: the bench's analog gyro with a converter of its own, which sends samples.

    rate = (U - U0) / K0,    temperature = (thermistor volts - offset) / slope

so its rate is that of the simulated sensor, with all its physics and noise, scaled as it leaves the factory at T0 and
rounded as its frames demand. What this leaves out: compensation inside the gyro, so it errs as an analog one does; axes
across the table's; filters of its own; a clock of its own, its rate is exact. On a whole bench it is a second gyro of
the same make beside the analog one (`World.second_gyro`): both turn with one table and warm up in one chamber, and each
has its own noise.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.simulated.machines import AnalogInputs
from benchctl_instruments.simulated.push_line import PushLine
from benchctl_instruments.simulated.settings import WorldSettings
from benchctl_instruments.simulated.tcp_server import Startable

AXES = ("x", "y", "z")
BITS_PER_BYTE = 10  # 8N1
LARGEST_BATCH = 4096  # frames that are made at once
ROUNDING = 1e-6  # of a sample interval: how long after its instant a frame counts as due


class DigitalGyro(Startable, ABC):
    """A gyro at `address` that sends frames, from `start()` to `stop()`, or in a `with`.

    A frame is due when a line of `baud` would have carried its last byte. Its instants are even on the bench's clock;
    what is late is sent late, and what the line does not take is lost.

    Parameters
    ----------
    inputs
        What the sensor puts out.
    settings
        The bench that `inputs` belong to.
    baud
        The line's speed.
    over_tcp
        Serial over TCP instead of a pseudo-terminal.

    Attributes
    ----------
    line
        What the frames go out on; it counts what it dropped, and can be disturbed.
    sent
        How many frames were made.
    """

    frame_bytes: int

    def __init__(self, inputs: AnalogInputs, settings: WorldSettings, *, baud: int, over_tcp: bool) -> None:
        sensor = settings.response or settings.gyro
        self._K0_v_per_dps, self._U0_v = sensor.K0_v_per_dps, sensor.U0_v
        self._slope_v_per_c, self._offset_v = settings.thermistor_v_per_c, settings.thermistor_offset_v
        self._inputs = inputs
        self._baud = baud
        self._first_s = math.nan  # of the stream; nan while none runs
        self._rate_hz = math.nan
        self._made = 0  # in this stream
        self.sent = 0
        self._batch_s: FloatArray = np.empty(0)  # the instants of the frames that were made last
        self.line = PushLine(self, baud=baud, over_tcp=over_tcp)

    @property
    def address(self) -> str:
        """Where it is, known once it is started."""
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
        """Take what the host said, and answer what is complete."""

    @property
    def batch_s(self) -> FloatArray:
        """Bench times [s] at which the frames that `due` gave last were sampled, shape (n,)."""
        return self._batch_s

    @abstractmethod
    def _skip(self, frames: int) -> None:
        """Count frames that are not made."""

    @abstractmethod
    def _frames(self, rate_dps: FloatArray, temperature_c: FloatArray) -> bytes:
        """Frames of samples, each of shape (n,), about the table's axis."""

    def due(self) -> bytes:
        """The frames that should have left by now, at most a batch."""
        samples = min(self._late, LARGEST_BATCH)
        if samples < 1:
            return b""
        interval_s = 1.0 / self._rate_hz
        _, gyro_v, thermistor_v = self._inputs.sample(self._first_s, interval_s, samples, start=self._made)
        self._batch_s = self._first_s + np.arange(self._made, self._made + samples, dtype=np.float64) * interval_s
        self._made += samples
        self.sent += samples
        self._inputs.hold_history(self._first_s + self._made * interval_s)
        return self._frames(
            (gyro_v - self._U0_v) / self._K0_v_per_dps, (thermistor_v - self._offset_v) / self._slope_v_per_c
        )

    def lose(self) -> None:
        """Nobody listens: what is late by now is lost as well, and never made."""
        if (late := self._late) > 0:
            self._skip(late)
            self._made += late
            self._inputs.hold_history(self._first_s + self._made / self._rate_hz)

    def wait(self, timeout_s: float) -> bool:
        """Wait for the next frame; at once false while no stream runs."""
        if math.isnan(self._first_s):
            return False
        next_s = self._first_s + (self._made + 2.0 * ROUNDING) / self._rate_hz + self._wire_s
        self._inputs.wait_until(next_s, timeout_s)
        return True

    @property
    def _late(self) -> int:
        """How many frames should have left by now and are not made."""
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


def axis_index(axis: str) -> int:
    """The place of "x", "y" or "z" among a gyro's axes."""
    if axis not in AXES:
        raise UsageError(f"axis {axis!r}: a simulated gyro has x, y and z")
    return AXES.index(axis)


def on_axis(values: FloatArray, axis: int) -> FloatArray:
    """Three axes, shape (n, 3), of which only one turns."""
    three = np.zeros((values.size, 3))
    three[:, axis] = values
    return three
