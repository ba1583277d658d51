"""Interfaces of the simulated machines that simulated servers use, without links.

`benchctl_instruments.simulated.world.World` provides all three. Every method is thread-safe, and every answer is that
of the bench clock's present instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from benchctl_instruments.arrays import FloatArray, IntArray

SINGLE_READING_S = 1e-3
"""One single reading averages the gyro's white noise over this time, in every instrument."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableMotion:
    """Motion of the table: angle unwrapped [deg], rate [deg/s], acceleration [deg/s²]."""

    angle_deg: float
    rate_dps: float
    acceleration_dps2: float


class TableMachine(Protocol):
    """A servo axis. A demand holds until the next one; acceleration and rate stay within the limits."""

    def motion(self) -> TableMotion:
        """Return the present motion."""

    def close_loop(self) -> None:
        """Switch the servo on, holding the present angle."""

    def open_loop(self) -> None:
        """Switch the servo off: friction stops the table."""

    def limits(self) -> tuple[float, float]:
        """Return the limits of rate [deg/s] and acceleration [deg/s²]."""

    def set_limits(self, rate_dps: float, acceleration_dps2: float) -> None:
        """Set the limits for later demands."""

    def demand_rate(self, rate_dps: float) -> None:
        """Turn at a constant rate."""

    def demand_angle(self, angle_deg: float) -> None:
        """Go to an unwrapped angle and hold it."""

    def demand_sine(self, amplitude_deg: float, frequency_hz: float, phase_deg: float, slew_deg_per_s: float) -> None:
        """Oscillate about the present angle; the amplitude grows from zero at the slew rate."""


class ChamberMachine(Protocol):
    """A chamber's temperature loop."""

    def air_c(self) -> float:
        """Return the present air temperature."""

    def setpoint_c(self) -> float:
        """Return the set point."""

    def set_setpoint(self, setpoint_c: float) -> None:
        """Set a new set point; the air follows within the ramp limit."""

    def power_percent(self) -> float:
        """Return the present heating (+) or cooling (-) power, -100 to 100."""

    def running(self) -> bool:
        """Return whether it conditions."""

    def run(self, on: bool) -> None:
        """Switch conditioning on or off; off, the air drifts to the room's temperature."""


class AnalogInputs(Protocol):
    """The digitizer's terminals: signals of the encoder's lines, the gyro and its thermistor's amplifier."""

    def now(self) -> float:
        """Return the bench time [s] of the present instant."""

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until an instant of bench time, at most `timeout_s` of wall time; return whether it was reached."""

    def hold_history(self, since_s: float | None) -> None:
        """Keep the motion since an instant, so that it can be sampled later; None: no longer needed."""

    def sample(
        self, first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return quadrature count (unwrapped), gyro and thermistor volts at equidistant instants, none in the future.

        These are scans `start`, `start` + 1, … of a stream that begins at `first_s`: the stream does not depend on how
        it is divided into calls, to the last bit. Instants must not decrease from one call to the next while a stream
        runs; volts are analog, before any converter, with the sensor's own noise. Each of shape (scans,).
        """


class GyroInputs(AnalogInputs, Protocol):
    """The sensors inside a digital gyro: an analog gyro, or three axes."""

    def sample_axes(
        self, along: str, first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> tuple[FloatArray, FloatArray]:
        """Return what a unit of three axes measures at the same instants: rates [deg/s] (scans, 3), °C (scans,).

        `along` is the axis that is up before anybody turned the unit: "x", "y" or "z".
        """
