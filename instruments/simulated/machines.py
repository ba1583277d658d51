"""What a simulated server needs of the simulated bench behind it: the machines, without any wire.

`benchctl_instruments.simulated.world.World` provides all three. Every method is safe to call from any thread, and every
answer is that of the bench clock's present instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from benchctl_instruments.arrays import FloatArray, IntArray

SINGLE_READING_S = 1e-3
"""One unhurried reading averages the gyro's white noise over this time, whichever instrument takes it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableMotion:
    """Where the table is and how it moves: angle unwrapped [deg], rate [deg/s], acceleration [deg/s²]."""

    angle_deg: float
    rate_dps: float
    acceleration_dps2: float


class TableMachine(Protocol):
    """A servo axis. A demand holds until the next one; acceleration and rate stay within the limits."""

    def motion(self) -> TableMotion:
        """The motion now."""

    def close_loop(self) -> None:
        """Servo on, holding the present angle."""

    def open_loop(self) -> None:
        """Servo off: friction stops the table."""

    def limits(self) -> tuple[float, float]:
        """Rate [deg/s] and acceleration [deg/s²] limits."""

    def set_limits(self, rate_dps: float, acceleration_dps2: float) -> None:
        """New limits, for demands from now on."""

    def demand_rate(self, rate_dps: float) -> None:
        """Turn at a constant rate."""

    def demand_angle(self, angle_deg: float) -> None:
        """Go to an unwrapped angle and hold it."""

    def demand_sine(self, amplitude_deg: float, frequency_hz: float, phase_deg: float, slew_deg_per_s: float) -> None:
        """Oscillate about the present angle; the amplitude grows from zero at the slew rate."""


class ChamberMachine(Protocol):
    """A chamber's temperature loop."""

    def air_c(self) -> float:
        """Air temperature now."""

    def setpoint_c(self) -> float:
        """The set point."""

    def set_setpoint(self, setpoint_c: float) -> None:
        """A new set point; the air follows within the ramp limit."""

    def power_percent(self) -> float:
        """Heating (+) or cooling (-) power now, -100 to 100."""

    def running(self) -> bool:
        """Whether it conditions."""

    def run(self, on: bool) -> None:
        """Conditioning on or off; off, the air drifts to the room's temperature."""


class AnalogInputs(Protocol):
    """What the digitizer's terminals see: the encoder's lines, the gyro's output and its thermistor's amplifier."""

    def now(self) -> float:
        """Bench time [s] of the present instant."""

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until the bench clock has reached an instant, at most `timeout_s` of wall time; whether it has."""

    def hold_history(self, since_s: float | None) -> None:
        """Keep the motion since an instant, so that it can be sampled later; None: no more needed."""

    def sample(
        self, first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Quadrature count (unwrapped), gyro volts and thermistor volts at evenly spaced instants, none in the future.

        These are scans `start`, `start` + 1, … of those that begin at `first_s`: a stream that is taken in pieces is to
        the last bit the same whatever the pieces.
        Instants must not go back from one call to the next while a stream runs; volts are analog, before any converter,
        with the sensor's own noise. Each of shape (scans,).
        """
