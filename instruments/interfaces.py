"""Protocols of a rate table, a chamber, a digitizer, a digital gyro and a clock, common to all manufacturers.

Units: angles in degrees and rates in degrees per second, positive counter-clockwise from above; temperatures in °C;
volts; seconds. Every method either does what it describes, confirmed by reading back, or raises one of `errors`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol, Self, runtime_checkable

from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.mounting import Position as Position


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """The identity that an instrument reports; unreported fields are empty strings."""

    manufacturer: str = ""
    model: str = ""
    serial: str = ""
    firmware: str = ""


class TableState(Enum):
    """The states of a rate table, sorted from disabled to moving."""

    DISABLED = "disabled"
    FAULT = "fault"
    AT_REST = "at rest"
    MOVING = "moving"


@dataclass(frozen=True, slots=True, kw_only=True)
class TableLimits:
    """Limits enforced by the controller itself, in addition to those that the suite monitors."""

    rate_dps: float
    acceleration_dps2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TableReading:
    """Angle [0, 360), rate and acceleration from one combined read, as reported by the controller.

    If the controller reports no acceleration, `acceleration_dps2` is derived from reads of the rate, or NaN.
    """

    angle_deg: float
    rate_dps: float
    acceleration_dps2: float


class Instrument(Protocol):
    """Methods common to all instruments; `with` opens the instrument and closes its link."""

    def open(self) -> None:
        """Connect and check that the right instrument answers."""

    def close(self) -> None:
        """Close the link; safe to call twice, and never raises."""

    def identify(self) -> Identity:
        """Return the instrument's identity."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class RateTable(Instrument, Protocol):
    """A single-axis rate table.

    A driver whose controller does not support sinusoids has the class attribute `oscillates = False`.
    """

    def set_limits(self, limits: TableLimits) -> None:
        """Program the controller's own limits."""

    def enable(self) -> None:
        """Clear latched faults, close the servo loop and hold still."""

    def disable(self) -> None:
        """Open the servo loop; the table must be at rest."""

    def go_to_rate(self, rate_dps: float) -> None:
        """Start to turn at a constant rate, reached within the acceleration limit; returns at once."""

    def go_to_angle(self, angle_deg: float) -> None:
        """Start to turn to an angle by the shorter way, and hold it; returns at once."""

    def oscillate(self, amplitude_dps: float, frequency_hz: float) -> None:
        """Start to oscillate about the present angle; `amplitude_dps` is the peak of the rate. Returns at once.

        Raises `UsageError` if the controller does not support sinusoids.
        """

    def stop(self) -> None:
        """Start a controlled stop; returns at once, the rate reaches zero within the acceleration limit."""

    def read(self) -> TableReading:
        """Return the present angle, rate and acceleration."""

    def state(self) -> TableState:
        """Return the present state; raises `InstrumentError` only if the answer is invalid."""


@runtime_checkable
class Homes(Protocol):
    """What the driver of a rate table with a home mark implements in addition."""

    def home(self, meanwhile: Callable[[], None]) -> None:
        """Turn slowly to the home mark, from which the angle then counts; return when the table rests there.

        `meanwhile` is called again and again until then and waits a while; an exception from it ends the waiting, and
        `stop` ends the motion.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberReading:
    """Air temperature and set point in °C, heating (+) or cooling (-) power in percent, texts of active alarms."""

    temperature_c: float
    setpoint_c: float
    power_percent: float
    alarms: tuple[str, ...] = ()


class Chamber(Instrument, Protocol):
    """A climate chamber's temperature loop."""

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the controller's own set point limits."""

    def start(self) -> None:
        """Switch conditioning on."""

    def stop(self) -> None:
        """Switch conditioning off; the set point does not change."""

    def go_to(self, setpoint_c: float) -> None:
        """Set a new set point; returns at once, the air follows within the chamber's ramp."""

    def read(self) -> ChamberReading:
        """Return air temperature, set point, power and alarms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamStart:
    """Actual rate and start time of the digitizer's stream.

    `rate_hz` is the actual scan rate; `start_s` is the instant of the first scan on the digitizer's own counter,
    unwrapped, counted from `open()`.
    """

    rate_hz: float
    start_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanBlock:
    """Scans that were taken together in hardware, oldest first.

    `first_index` counts scans from the start of the stream, including skipped ones: scan i of the block was sampled at
    `start_s + (first_index + i) / rate_hz`, and a gap is a jump of `first_index`. `encoder_count` is the raw quadrature
    count, signed and unwrapped within the stream, shape (n,); `gyro_v` and `thermistor_v` are calibrated volts, shape
    (n,). `backlog` is the number of scans still buffered in the instrument.
    """

    first_index: int
    encoder_count: IntArray
    gyro_v: FloatArray
    thermistor_v: FloatArray
    backlog: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleScan:
    """One reading of each input outside a stream: raw count, gyro volts, thermistor volts."""

    encoder_count: int
    gyro_v: float
    thermistor_v: float


class Digitizer(Instrument, Protocol):
    """A digitizer that samples the encoder's count, the gyro's volts and its thermistor in one hardware-timed scan.

    A driver whose instrument has no input for an encoder has the class attribute `counts_encoder = False`, and each
    count is 0. A driver of a slow instrument has `FASTEST_HZ`, its highest scan rate.
    """

    def read_once(self) -> SingleScan:
        """Return one reading of each input; no stream may be running."""

    def start_stream(self, rate_hz: float) -> StreamStart:
        """Start the hardware-timed stream."""

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        """Return at least `scans` scans and any others received, waiting at most `timeout_s` of wall time.

        Raises `LinkError` with the number of scans if fewer arrived in time. A gap ends a block, which may then be
        shorter than `scans`; the next call returns the scans after the gap.
        """

    def stop_stream(self) -> None:
        """Stop the stream and discard the scans buffered in the instrument. Safe to call if no stream runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroGap:
    """A gap just before sample `index` of a block: `lost` samples are missing according to the gyro's numbers.

    If `exact` is false, the line was unread for so long that the numbers may have wrapped: more samples may be missing,
    by complete wraps, and the times of later samples are only known relative to this gap.
    """

    index: int
    lost: int
    exact: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroCounts:
    """Counts of a gyro's stream since its start.

    `samples` were kept and `lost` are missing according to the gyro's numbers; `bad_frames` failed their check, and
    `junk_bytes` belonged to no valid frame, including those of the failed frames.
    """

    samples: int
    lost: int
    bad_frames: int
    junk_bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroBlock:
    """Samples of a digital gyro, oldest first; every array has shape (n,), but `rates_dps` (n, 3).

    `sequence` counts samples from the start of the stream, including lost ones: by the gyro's own clock, sample i was
    measured at sequence[i] / rate_hz. `rate_dps` is about the one axis that the driver is set to read. `rates_dps`
    are those about the gyro's axes x, y and z; NaN: that axis has no valid sample. `status` is as reported, `valid` is
    whether it marks the sample of the one axis as good, and `faults` are the texts of all faults within the block.
    `counts` are those of the entire stream. The gyro's own numbers repeat after `wrap` samples.
    """

    sequence: IntArray
    rate_dps: FloatArray
    rates_dps: FloatArray
    temperature_c: FloatArray
    status: IntArray
    valid: BoolArray
    faults: tuple[str, ...]
    gaps: tuple[GyroGap, ...]
    counts: GyroCounts
    wrap: int


class Gyro(Instrument, Protocol):
    """A gyro with a digital output that sends samples spontaneously."""

    def start_stream(self, rate_hz: float) -> float:
        """Start the stream and return its actual rate [Hz]. Samples older than this call are not returned."""

    def read_stream(self, samples: int, timeout_s: float) -> GyroBlock:
        """Return at least `samples` samples and any others received, waiting at most `timeout_s` of wall time.

        Raises `LinkError` with the number of samples if fewer arrived in time; these are kept for the next call.
        """

    def stop_stream(self) -> None:
        """Stop the stream and discard unread samples. Safe to call if no stream runs."""


class Clock(Protocol):
    """The source of bench time: the host's clock, or that of the simulated bench."""

    def now(self) -> float:
        """Return the seconds of bench time since the clock was created; never decreases."""

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of bench time."""

    @property
    def chunk_s(self) -> float:
        """Longest bench time between two checks of the bench: 0.5 s if bench time is wall time."""
