"""What a rate table, a chamber, a digitizer, a digital gyro and a clock are, whoever built them.

Angles in degrees and rates in degrees a second, positive counter-clockwise seen from above; temperatures in °C; volts;
seconds. Every method either does what it says, confirmed by reading back, or raises one of `errors`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol, Self

from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.mounting import Position as Position


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Who an instrument says that it is; an empty string where it does not say."""

    manufacturer: str = ""
    model: str = ""
    serial: str = ""
    firmware: str = ""


class TableState(Enum):
    """The states of a rate table, least alive first."""

    DISABLED = "disabled"
    FAULT = "fault"
    AT_REST = "at rest"
    MOVING = "moving"


@dataclass(frozen=True, slots=True, kw_only=True)
class TableLimits:
    """Limits held by the controller itself, beside those that the suite watches."""

    rate_dps: float
    acceleration_dps2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TableReading:
    """Angle [0, 360), rate and acceleration in one combined read, as the controller states them.

    Where the controller states no acceleration, `acceleration_dps2` is what reads of the rate prove, or not a number.
    """

    angle_deg: float
    rate_dps: float
    acceleration_dps2: float


class Instrument(Protocol):
    """What every instrument can do; `with` opens it and closes its link."""

    def open(self) -> None:
        """Connect and make sure that the right instrument answers."""

    def close(self) -> None:
        """Let go of the link; safe to call twice, and never raises."""

    def identify(self) -> Identity:
        """Who it is."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class RateTable(Instrument, Protocol):
    """A single-axis rate table.

    A driver whose controller has no sinusoid says so beforehand, by an attribute of its class, `oscillates = False`.
    """

    def set_limits(self, limits: TableLimits) -> None:
        """Program the controller's own limits."""

    def enable(self) -> None:
        """Clear latched faults, close the servo loop and hold still."""

    def disable(self) -> None:
        """Open the servo loop; the table must be at rest."""

    def go_to_rate(self, rate_dps: float) -> None:
        """Turn at a constant rate, reached within the acceleration limit; returns at once."""

    def go_to_angle(self, angle_deg: float) -> None:
        """Turn to an angle, the short way round, and hold it; returns at once."""

    def oscillate(self, amplitude_dps: float, frequency_hz: float) -> None:
        """Oscillate about the present angle; `amplitude_dps` is the peak of the rate. Returns at once.

        Raises `UsageError` where the controller has no sinusoid.
        """

    def stop(self) -> None:
        """A controlled stop; returns at once, the rate reaches zero within the acceleration limit."""

    def read(self) -> TableReading:
        """Angle, rate and acceleration now."""

    def state(self) -> TableState:
        """What it is doing; raises `InstrumentError` only where the answer makes no sense."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberReading:
    """Air temperature and set point in °C, heating (+) or cooling (-) power in percent, active alarms in words."""

    temperature_c: float
    setpoint_c: float
    power_percent: float
    alarms: tuple[str, ...] = ()


class Chamber(Instrument, Protocol):
    """A climate chamber's temperature loop."""

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the controller's own set point limits."""

    def start(self) -> None:
        """Conditioning on."""

    def stop(self) -> None:
        """Conditioning off; the set point stays as it is."""

    def go_to(self, setpoint_c: float) -> None:
        """A new set point; returns at once, the air follows within the chamber's ramp."""

    def read(self) -> ChamberReading:
        """Air, set point, power, alarms now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamStart:
    """What the digitizer really does once its stream runs.

    `rate_hz` is the actual scan rate; `start_s` the instant of the first scan on the digitizer's own counter,
    unwrapped, counted from `open()`.
    """

    rate_hz: float
    start_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanBlock:
    """Scans that were taken together in hardware, oldest first.

    `first_index` counts scans from the start of the stream and includes the skipped ones, so that scan i of the block
    was taken at `start_s + (first_index + i) / rate_hz` and a gap shows as a jump of `first_index`. `encoder_count` is
    the raw quadrature count, signed and unwrapped within the stream, shape (n,); `gyro_v` and `thermistor_v` are
    calibrated volts, shape (n,). `backlog` is the number of scans that still wait in the instrument.
    """

    first_index: int
    encoder_count: IntArray
    gyro_v: FloatArray
    thermistor_v: FloatArray
    backlog: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleScan:
    """One unhurried reading of each input: raw count, gyro volts, thermistor volts."""

    encoder_count: int
    gyro_v: float
    thermistor_v: float


class Digitizer(Instrument, Protocol):
    """Samples the encoder's count, the gyro's volts and its thermistor in one hardware-timed scan."""

    def read_once(self) -> SingleScan:
        """One reading of each input, while no stream runs."""

    def start_stream(self, rate_hz: float) -> StreamStart:
        """Start the hardware-timed stream."""

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        """At least `scans` scans and whatever else has arrived, waiting at most `timeout_s` of wall time.

        Raises `LinkError` where fewer came in time, naming how many. A gap ends a block: what follows it comes with the
        next call, so a block may then be shorter than `scans`.
        """

    def stop_stream(self) -> None:
        """Stop; what still waits in the instrument is discarded. Safe to call where no stream runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroGap:
    """Samples are missing just before sample `index` of a block: `lost` of them, by the gyro's own numbers.

    Where `exact` is false the line was not heard for so long that the numbers may have wrapped meanwhile: more may be
    missing by whole wraps, and the times of what follows are known from here on only.
    """

    index: int
    lost: int
    exact: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroCounts:
    """What a gyro's stream has brought since its start.

    `samples` were kept, `lost` are missing by the gyro's own numbers; `bad_frames` failed their check, and `junk_bytes`
    belonged to no good frame, those of failed ones included.
    """

    samples: int
    lost: int
    bad_frames: int
    junk_bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroBlock:
    """Samples of a digital gyro's one axis, oldest first; every array of shape (n,).

    `sequence` counts samples from the start of the stream, lost ones included: by the gyro's own clock sample i was
    taken at sequence[i] / rate_hz. `rate_dps` is about the gyro's own axis. `status` is as the gyro states it, `valid`
    whether it vouches for the sample, and `faults` are the words of everything that was wrong anywhere in the block.
    `counts` are those of the whole stream. After `wrap` samples the gyro's own numbers come again.
    """

    sequence: IntArray
    rate_dps: FloatArray
    temperature_c: FloatArray
    status: IntArray
    valid: BoolArray
    faults: tuple[str, ...]
    gaps: tuple[GyroGap, ...]
    counts: GyroCounts
    wrap: int


class Gyro(Instrument, Protocol):
    """A gyro with a digital output, which sends samples by itself."""

    def start_stream(self, rate_hz: float) -> float:
        """Have it send samples; the rate [Hz] at which it does. Nothing older than this call is read."""

    def read_stream(self, samples: int, timeout_s: float) -> GyroBlock:
        """At least `samples` samples and whatever came with them, waiting at most `timeout_s` of wall time.

        Raises `LinkError` where fewer came in time, naming how many; they are kept for the next call.
        """

    def stop_stream(self) -> None:
        """Stop; what was not read is discarded. Safe to call where no stream runs."""


class Clock(Protocol):
    """Where the runner takes its time from: the host's clock, or that of the simulated bench."""

    def now(self) -> float:
        """Seconds of bench time since the clock was made; never goes back."""

    def sleep(self, seconds: float) -> None:
        """Let that much bench time pass."""

    @property
    def chunk_s(self) -> float:
        """How much bench time may pass between two looks at the bench: 0.5 s where bench time is wall time."""
