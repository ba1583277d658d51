"""The instruments' interfaces directly on the simulated world: the same bench without links."""

from __future__ import annotations

import math
from collections.abc import Callable

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import InstrumentError, LinkError, UsageError
from benchctl_instruments.interfaces import (
    ChamberReading,
    Identity,
    Instrument,
    ScanBlock,
    SingleScan,
    StreamStart,
    TableLimits,
    TableReading,
    TableState,
)
from benchctl_instruments.physics.adc import codes_from_volts, volts_from_codes
from benchctl_instruments.simulated.machines import SINGLE_READING_S, TableMotion
from benchctl_instruments.simulated.world import World

_REST_DPS = 0.005
_REST_DPS2 = 0.5
_PERIODS_OF_GROWTH = 2.0


class _Direct(Instrument):
    """An instrument without a link."""

    _model: str

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def identify(self) -> Identity:
        """Return the simulated instrument's name."""
        return Identity(manufacturer="benchctl", model=self._model)


class DirectRateTable(_Direct):
    """A `RateTable` over `World.table`."""

    _model = "simulated rate table"

    def __init__(self, world: World) -> None:
        self._table = world.table
        self._enabled = False

    def set_limits(self, limits: TableLimits) -> None:
        """Set the limits for later motions."""
        self._table.set_limits(limits.rate_dps, limits.acceleration_dps2)

    def enable(self) -> None:
        """Switch the servo on and hold still."""
        self._table.close_loop()
        self._enabled = True

    def disable(self) -> None:
        """Switch the servo off; refused while the table moves."""
        if _moves(self._table.motion()):
            raise InstrumentError("the rate table was to be disabled while it moves; stop it first")
        self._table.open_loop()
        self._enabled = False

    def go_to_rate(self, rate_dps: float) -> None:
        """Start to turn at a constant rate."""
        self._refuse_beyond(abs(rate_dps), "a rate", self._table.limits()[0], "deg/s")
        self._table.demand_rate(rate_dps)

    def go_to_angle(self, angle_deg: float) -> None:
        """Start to turn to an angle by the shorter way, and hold it."""
        self._refuse_disabled()
        if not math.isfinite(angle_deg):
            raise UsageError(f"an angle of {angle_deg} deg; give a finite one")
        here_deg = self._table.motion().angle_deg
        self._table.demand_angle(here_deg + math.remainder(angle_deg - here_deg, 360.0))

    def home(self, meanwhile: Callable[[], None]) -> None:
        """Turn to the angle 0, the home mark."""
        self.go_to_angle(0.0)
        meanwhile()
        while _moves(self._table.motion()):
            meanwhile()

    def oscillate(self, amplitude_dps: float, frequency_hz: float) -> None:
        """Start to oscillate about the present angle; full amplitude after two periods if the limits permit it."""
        if not (amplitude_dps > 0.0 and frequency_hz > 0.0):
            raise UsageError(f"an oscillation of {amplitude_dps} deg/s at {frequency_hz} Hz; give both above 0")
        rate_limit_dps, acceleration_limit_dps2 = self._table.limits()
        omega = 2.0 * math.pi * frequency_hz
        self._refuse_beyond(amplitude_dps, "a rate", rate_limit_dps, "deg/s")
        self._refuse_beyond(amplitude_dps * omega, "an acceleration", acceleration_limit_dps2, "deg/s²")
        amplitude_deg = amplitude_dps / omega
        self._table.demand_sine(amplitude_deg, frequency_hz, 0.0, amplitude_deg * frequency_hz / _PERIODS_OF_GROWTH)

    def stop(self) -> None:
        """Start a controlled stop."""
        self._table.demand_rate(0.0)

    def read(self) -> TableReading:
        """Return the present true motion, the angle in [0, 360)."""
        motion = self._table.motion()
        return TableReading(
            angle_deg=motion.angle_deg % 360.0,
            rate_dps=motion.rate_dps,
            acceleration_dps2=motion.acceleration_dps2,
        )

    def state(self) -> TableState:
        """Return MOVING while rate or acceleration is significant, which includes the turning points of a sine."""
        if not self._enabled:
            return TableState.DISABLED
        return TableState.MOVING if _moves(self._table.motion()) else TableState.AT_REST

    def _refuse_disabled(self) -> None:
        if not self._enabled:
            raise InstrumentError("the rate table was to move while it is disabled; enable it first")

    def _refuse_beyond(self, value: float, what: str, limit: float, unit: str) -> None:
        self._refuse_disabled()
        if not value <= limit:  # also refuses NaN
            raise InstrumentError(
                f"the rate table was commanded to {what} of {value:g} {unit}, its limit is {limit:g} {unit}"
            )


class DirectChamber(_Direct):
    """A `Chamber` over `World.chamber`."""

    _model = "simulated chamber"

    def __init__(self, world: World) -> None:
        self._chamber = world.chamber
        self._low_c, self._high_c = -math.inf, math.inf

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Set the set point limits."""
        if not low_c < high_c:
            raise UsageError(f"set point limits of {low_c} to {high_c} °C; give the lower one first")
        self._low_c, self._high_c = low_c, high_c

    def start(self) -> None:
        """Switch conditioning on."""
        self._chamber.run(True)

    def stop(self) -> None:
        """Switch conditioning off."""
        self._chamber.run(False)

    def go_to(self, setpoint_c: float) -> None:
        """Set a new set point."""
        if not self._low_c <= setpoint_c <= self._high_c:
            raise InstrumentError(
                f"the chamber was commanded to {setpoint_c} °C, its limits are {self._low_c} to {self._high_c} °C"
            )
        self._chamber.set_setpoint(setpoint_c)

    def read(self) -> ChamberReading:
        """Return the present air temperature, set point and power; it has no alarms."""
        return ChamberReading(
            temperature_c=self._chamber.air_c(),
            setpoint_c=self._chamber.setpoint_c(),
            power_percent=self._chamber.power_percent(),
        )


class DirectDigitizer(_Direct):
    """A `Digitizer` over `World.inputs`; volts pass through a 16-bit converter over ±`adc_range_v`."""

    _model = "simulated digitizer"

    def __init__(self, world: World, *, adc_range_v: float = 10.0) -> None:
        self._inputs = world.inputs
        self._adc_range_v = adc_range_v
        self._opened_s = 0.0
        self._stream: StreamStart | None = None
        self._scanned = 0

    def open(self) -> None:
        """Start the counter of `StreamStart.start_s`."""
        self._opened_s = self._inputs.now()

    def close(self) -> None:
        """Stop the stream."""
        self.stop_stream()

    def read_once(self) -> SingleScan:
        """Return one reading of each input."""
        if self._stream is not None:
            raise UsageError("a single reading was requested while the stream runs; stop it first")
        counts, gyro_v, thermistor_v = self._inputs.sample(self._inputs.now(), SINGLE_READING_S, 1)
        return SingleScan(
            encoder_count=int(counts[0]),
            gyro_v=float(self._converted(gyro_v)[0]),
            thermistor_v=float(self._converted(thermistor_v)[0]),
        )

    def start_stream(self, rate_hz: float) -> StreamStart:
        """Start to scan."""
        if self._stream is not None:
            raise UsageError("a stream was to start while another runs; stop it first")
        if not 0.0 < rate_hz < math.inf:
            raise UsageError(f"a stream of {rate_hz} scans a second; give a finite rate above 0")
        now = self._inputs.now()
        self._inputs.hold_history(now)
        self._stream = StreamStart(rate_hz=rate_hz, start_s=now - self._opened_s)
        self._scanned = 0
        return self._stream

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        """Return all scans that are due, at least `scans`, and at least one."""
        if self._stream is None:
            raise UsageError("scans were requested while no stream runs; start one first")
        scans = max(scans, 1)
        first_s, interval_s = self._opened_s + self._stream.start_s, 1.0 / self._stream.rate_hz
        enough_s = first_s + (self._scanned + scans - 1) * interval_s
        came = self._inputs.wait_until(enough_s, timeout_s)
        due = math.floor((self._inputs.now() - first_s + 1e-9) * self._stream.rate_hz) + 1 - self._scanned
        if not came:
            raise LinkError(f"{scans} scans were requested, {due} came within {timeout_s} s")
        counts, gyro_v, thermistor_v = self._inputs.sample(first_s, interval_s, due, start=self._scanned)
        block = ScanBlock(
            first_index=self._scanned,
            encoder_count=counts,
            gyro_v=self._converted(gyro_v),
            thermistor_v=self._converted(thermistor_v),
        )
        self._scanned += due
        self._inputs.hold_history(first_s + self._scanned * interval_s)
        return block

    def stop_stream(self) -> None:
        """Stop the stream and discard unread scans."""
        self._stream = None
        self._inputs.hold_history(None)

    def _converted(self, volts: FloatArray) -> FloatArray:
        return volts_from_codes(codes_from_volts(volts, range_v=self._adc_range_v), range_v=self._adc_range_v)


def _moves(motion: TableMotion) -> bool:
    return abs(motion.rate_dps) > _REST_DPS or abs(motion.acceleration_dps2) > _REST_DPS2
