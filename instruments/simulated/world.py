"""The simulated bench without links: a table, a chamber and a gyro with its terminals, sharing one clock.

`Terminals` are the digitizer's terminals: the encoder's count, the gyro's volts and its thermistor's, at equidistant
instants. Up to the gyro's electronics the chain runs on the internal grid; scans are interpolated from it (angle by a
cubic through angles and rates, volts linearly) and get the sensor's noise. If encoder and gyro have two clocks, the
gyro's volts are sampled at its own instants, everything else at the encoder's. A gyro whose supply is off outputs 0 V;
its thermistor still works.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

# The physics import these when first used; that takes a second, during which a client could time out.
import scipy.signal
import scipy.special  # noqa: F401

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import Position
from benchctl_instruments.mounting import AXES, AxisPosition
from benchctl_instruments.physics.chain import GRID_STAGES, Baseline, Effect, Signals, run_chain
from benchctl_instruments.physics.effects.kinds import ClockEffect, FilterEffect
from benchctl_instruments.physics.encoder import encoder_angle_deg, quadrature_count
from benchctl_instruments.physics.noise import RandomWalk, WhiteNoise
from benchctl_instruments.physics.structure_places import CHAMBER_C, SETPOINT_WAY
from benchctl_instruments.physics.structures import Structure
from benchctl_instruments.physics.three_axes import ThreeAxisParameters, noise_deviation_dps, sensed_rates_dps
from benchctl_instruments.physics.turn_on import warming_up_since
from benchctl_instruments.simulated.axis import TableAxis
from benchctl_instruments.simulated.climate import ClimateChamber
from benchctl_instruments.simulated.clock import BenchClock, Timebase
from benchctl_instruments.simulated.machines import AnalogInputs, ChamberMachine, GyroInputs, TableMachine
from benchctl_instruments.simulated.sensor import Installation, Installed, Sensor, sensor_of
from benchctl_instruments.simulated.settings import WorldSettings

_ROOM_S = 3600.0
_NEXT_SCAN = 0.5
"""Fraction of an interval by which a scan may deviate from its place in a stream."""


class TwoClocks:
    """Sampling instants of encoder and gyro for the stamps of scans, in the order of time and none in the future.

    Only the shift between the gyro's instants and the encoder's is visible in a recording. If the gyro would have to be
    sampled in the future, the complete scan is therefore taken earlier: at stamp t the encoder is read at t − lead and
    the gyro at t − lead + shift(t), neither after t. Within a stream the lead is constant, with room for an hour of
    drift, so that the encoder's rate is the table's; after that the lead follows the drift, and the encoder's rate is
    wrong by the drift. A stream begins with the table's motion one lead earlier: milliseconds for an offset, but a
    second for a clock that has been fast by 100 ppm for three hours.
    """

    def __init__(self, effects: Sequence[ClockEffect]) -> None:
        self._effects = tuple(effects)
        self._next_s = -math.inf
        self._lead_s = 0.0

    def instants(self, stamps_s: FloatArray, interval_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the instants [s] of encoder and gyro for stamps [s] `interval_s` apart; each of shape (n,)."""
        if abs(stamps_s[0] - self._next_s) > _NEXT_SCAN * interval_s:
            ends_s = self._shift_s(stamps_s[0] + np.array([0.0, _ROOM_S]))
            self._lead_s = max(0.0, float(ends_s.max()))
        self._next_s = float(stamps_s[-1]) + interval_s
        shift_s = self._shift_s(stamps_s)
        encoder_s = stamps_s - np.maximum(shift_s, self._lead_s)
        return encoder_s, encoder_s + shift_s

    def reach_s(self, stamp_s: float) -> float:
        """Return how long before a stamp [s] instants may be."""
        ends_s = self._shift_s(stamp_s + np.array([0.0, _ROOM_S]))
        return float(max(0.0, ends_s.max()) + max(0.0, -ends_s.min()))

    def _shift_s(self, stamps_s: FloatArray) -> FloatArray:
        """Return how far the gyro's instants are after their stamps; several effects add up."""
        shift_s = np.zeros_like(stamps_s)
        for effect in self._effects:
            shift_s += effect.gyro_time_s(stamps_s)
            shift_s -= stamps_s
        return shift_s


_BLOCK = 32_768
"""Grid instants computed at once: few enough to fit into the processor's cache."""

_LONGEST_WARM_UP_S = 60.0
"""Longest warm-up; filters with a longer memory start from the steady state at this time before."""

_EARLY_S = 2e-9
"""How far a scan may be ahead of the clock: the rounding of instants that are days away."""

_ROUNDING = 1e-6
"""Tolerance, in grid intervals, for a scan to coincide with an instant of the grid."""


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Consecutive instants of the grid from `first` on: angle, rate, acceleration, sensed rate, volts; shape (5, n)."""

    first: int
    columns: FloatArray

    @property
    def end(self) -> int:
        return self.first + int(self.columns.shape[1])


class Terminals:
    """A `GyroInputs` over the table's axis and the chamber."""

    def __init__(
        self,
        timebase: Timebase,
        settings: WorldSettings,
        sensor: Sensor,
        axis: TableAxis,
        climate: ClimateChamber,
        installation: Installation,
        effects: Sequence[Effect] = (),
    ) -> None:
        self._timebase = timebase
        self._installation = installation
        self._settings = settings
        self._sensor = sensor
        self._axis = axis
        self._climate = climate
        self._effects = tuple(effects)
        of_air = ("chamber_temp", "setpoint")
        self._feels_air = any(isinstance(effect, Structure) and effect.over in of_air for effect in effects)
        self._law: tuple[Installed, Baseline, Sequence[Effect]] | None = None
        clocks = [effect for effect in effects if isinstance(effect, ClockEffect)]
        self._clocks = TwoClocks(clocks) if clocks else None
        filters_s = [effect.memory_s for effect in effects if isinstance(effect, FilterEffect)]
        self._warm_up_s = max(sensor.memory_s, min(sum(filters_s), _LONGEST_WARM_UP_S))
        self._warm_up = math.ceil(self._warm_up_s * timebase.grid_hz)
        white, walk, thermistor, axes = np.random.SeedSequence(settings.seed).spawn(4)
        self._white = WhiteNoise(white)
        self._walk = RandomWalk(walk, sensor.walk_v_per_sqrt_s)
        self._thermistor = WhiteNoise(thermistor)
        self._axes = WhiteNoise(axes)
        self._grid: _Stretch | None = None
        self._last_instant: tuple[tuple[float, float], Signals] | None = None
        self._scanned = 0
        self._memory: Mapping[str, FloatArray] = {}

    def now(self) -> float:
        """Return the bench time [s]."""
        return self._timebase.now()

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until an instant of bench time, at most `timeout_s` of wall time; return whether it was reached."""
        return self._timebase.clock.wait_until(bench_time_s, timeout_s)

    def hold_history(self, since_s: float | None) -> None:
        """Keep the motion since an instant; None: no longer needed."""
        with self._timebase.lock:
            self._timebase.held_since_s = since_s

    def sample(
        self, first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return count, gyro volts, thermistor volts at first + (start + i)·interval, i < scans: shape (scans,)."""
        counts = np.empty(scans, np.int64)
        gyro_v, thermistor_v = np.empty(scans), np.empty(scans)
        sampling: Baseline = {"sampling": self._with_noise}
        with self._timebase.lock:
            self._refuse(first_s + start * interval_s, interval_s, scans)
            self._timebase.reach_s = self._reach_s(first_s + start * interval_s)
            block = max(1, int(_BLOCK / (interval_s * self._timebase.grid_hz)))
            for low in range(0, scans, block):
                part = slice(low, min(low + block, scans))
                times_s = first_s + np.arange(start + part.start, start + part.stop, dtype=np.float64) * interval_s
                signals = run_chain(self._before_sampling(times_s, interval_s), sampling, self._effects, ("sampling",))
                self._scanned += times_s.size
                self._memory = signals.memory
                counts[part] = quadrature_count(self._settings.encoder, signals.encoder_deg)
                gyro_v[part] = signals.output_v
                if (dead := self._installation.dead(times_s)) is not None:
                    gyro_v[part][dead] = 0.0
                thermistor_v[part] = signals.thermistor_c
        thermistor_v *= self._settings.thermistor_v_per_c
        thermistor_v += self._settings.thermistor_offset_v
        return counts, gyro_v, thermistor_v

    def sample_axes(
        self, along: str, first_s: float, interval_s: float, scans: int, *, start: int = 0
    ) -> tuple[FloatArray, FloatArray]:
        """See `GyroInputs`; a unit without supply states 0 deg/s. Effects do not act on this unit."""
        unit = self._settings.three_axes or ThreeAxisParameters()
        with self._timebase.lock:
            self._refuse(first_s + start * interval_s, interval_s, scans)
            times_s = first_s + np.arange(start, start + scans, dtype=np.float64) * interval_s
            motion, celsius = self._axis.at(times_s), self._climate.gyro(times_s).housing_c
            placed, dead = list(self._installation.placed(times_s)), self._installation.dead(times_s)
        sensed = np.empty((scans, 3))
        for position, rows in placed:
            sensed[rows] = sensed_rates_dps(
                _axis_position(position, along),
                motion.rate_dps[rows],
                motion.angle_deg[rows],
                self._settings.latitude_deg,
            )
        noise = self._axes.draw(3 * scans, noise_deviation_dps(unit, interval_s)).reshape(scans, 3)
        rates = unit.output_dps(sensed, celsius) + noise
        if dead is not None:
            rates[dead] = 0.0
        return rates, celsius

    def _refuse(self, first_s: float, interval_s: float, scans: int) -> None:
        if scans < 1 or not interval_s > 0.0:
            raise UsageError(
                f"cannot sample {scans} scans every {interval_s} s; give one scan or more, and a time above 0"
            )
        last_s, now = first_s + (scans - 1) * interval_s, self._timebase.now()
        if last_s > now + _EARLY_S:
            raise UsageError(f"cannot sample at {last_s:.6f} s: it is {now:.6f} s, wait until then")

    def _reach_s(self, stamp_s: float) -> float:
        """Return how long before the kept history the gyro's instants and the start of filters may be."""
        return self._warm_up_s + (0.0 if self._clocks is None else self._clocks.reach_s(stamp_s))

    def _before_sampling(self, times_s: FloatArray, interval_s: float) -> Signals:
        """Do the same as `_at_scans`, with a cache for a client that reads several inputs at one instant."""
        if times_s.size > 1 or self._clocks is not None:
            return self._at_scans(times_s, interval_s)
        instant = float(times_s[0]), interval_s
        if self._last_instant is None or self._last_instant[0] != instant:
            self._last_instant = instant, self._at_scans(times_s, interval_s)
        return replace(self._last_instant[1], first_index=self._scanned, memory=self._memory)

    def _at_scans(self, times_s: FloatArray, interval_s: float) -> Signals:
        """Return the chain up to the electronics, interpolated to the instants of scans."""
        encoder_s = gyro_s = times_s
        if self._clocks is not None:
            encoder_s, gyro_s = self._clocks.instants(times_s, interval_s)
        position = gyro_s * self._timebase.grid_hz
        # the cell that ends at or after each instant: the next one may not be known yet
        low = np.ceil(position - _ROUNDING).astype(np.int64) - 1
        grid = self._computed(int(low[0]), int(low[-1]) + 1)
        share = position - low
        low -= grid.first
        left, right = grid.columns.take(low, axis=1), grid.columns.take(low + 1, axis=1)
        straight = left + (right - left) * share
        gyro = self._climate.gyro(encoder_s)
        if self._clocks is None:
            angle, rate, acceleration = (
                _cubic(left, right, share, 1.0 / self._timebase.grid_hz),
                straight[1],
                straight[2],
            )
        else:
            motion = self._axis.at(encoder_s)
            angle, rate, acceleration = motion.angle_deg, motion.rate_dps, motion.acceleration_dps2
        return Signals(
            first_index=self._scanned,
            interval_s=interval_s,
            time_s=times_s,
            angle_deg=angle,
            rate_dps=rate,
            acceleration_dps2=acceleration,
            housing_c=gyro.housing_c,
            coil_c=gyro.coil_c,
            coil_rate_c_per_s=gyro.coil_rate_c_per_s,
            sensed_rate_dps=straight[3],
            output_v=straight[4],
            encoder_deg=angle,
            thermistor_c=gyro.housing_c,
            auxiliary=self._of_air(encoder_s),
            memory=self._memory,
        )

    def _of_air(self, times_s: FloatArray) -> Mapping[str, FloatArray]:
        """Return the chamber's air and the direction of its set point if an effect needs them."""
        if not self._feels_air:
            return {}
        air_c, way = self._climate.air(times_s)
        return {CHAMBER_C: air_c, SETPOINT_WAY: way}

    def _computed(self, first: int, last: int) -> _Stretch:
        """Return the grid between two instants, continued from the last computed part if that is near."""
        known = self._grid
        if known is None or not known.first <= first <= known.end + self._warm_up:
            known = _Stretch(first - self._warm_up, np.empty((5, 0)))
        if known.end <= last:
            parts = [self._run(installed, *ends) for installed, *ends in self._installation.over(known.end, last)]
            known = _Stretch(known.first, np.concatenate([known.columns, *parts], axis=1))
        # the next scan may be in the last cell
        self._grid = _Stretch(known.end - 2, known.columns[:, -2:].copy())
        return known

    def _run(self, installed: Installed, start: int, last: int) -> FloatArray:
        """Return the columns of a `_Stretch` during which the installation is constant, continuing the previous run."""
        baseline, effects = self._law_of(installed)
        signals = run_chain(self._on_grid(start, last), baseline, effects, GRID_STAGES)
        self._memory = signals.memory
        return np.stack(
            [
                signals.angle_deg,
                signals.rate_dps,
                signals.acceleration_dps2,
                signals.sensed_rate_dps,
                signals.output_v,
            ]
        )

    def _law_of(self, installed: Installed) -> tuple[Baseline, Sequence[Effect]]:
        """Return the gyro's stages and effects for an installation; the latest ones are cached."""
        if self._law is None or self._law[0] is not installed:
            since_s = installed.on_since_s
            effects = self._effects if since_s is None else warming_up_since(self._effects, since_s)
            self._law = installed, self._sensor.baseline(installed.position, installed.times), effects
        return self._law[1:]

    def _on_grid(self, start: int, last: int) -> Signals:
        """Return the true motion and temperatures, before any stage."""
        times_s = np.arange(start, last + 1) / self._timebase.grid_hz
        motion = self._axis.at(times_s)
        gyro = self._climate.gyro(times_s)
        return Signals(
            first_index=start,
            interval_s=1.0 / self._timebase.grid_hz,
            time_s=times_s,
            angle_deg=motion.angle_deg,
            rate_dps=motion.rate_dps,
            acceleration_dps2=motion.acceleration_dps2,
            housing_c=gyro.housing_c,
            coil_c=gyro.coil_c,
            coil_rate_c_per_s=gyro.coil_rate_c_per_s,
            sensed_rate_dps=motion.rate_dps,
            output_v=np.zeros_like(times_s),
            encoder_deg=motion.angle_deg,
            thermistor_c=gyro.housing_c,
            auxiliary=self._of_air(times_s),
            memory=self._memory,
        )

    def _with_noise(self, signals: Signals) -> Signals:
        """Apply the baseline of the sampling stage: encoder, thermistor, noise and the output's limit."""
        scans = signals.time_s.size
        volts = signals.output_v + self._white.draw(scans, self._sensor.white_v(signals.interval_s))
        # of two readers that sample out of order, the later one gets the present bias
        volts += self._walk.at(np.maximum(signals.time_s, self._walk.last_s))
        np.clip(volts, -self._sensor.output_limit_v, self._sensor.output_limit_v, out=volts)
        warm = self._thermistor.draw(scans, self._settings.chamber.thermistor_noise_c)
        return replace(
            signals,
            output_v=volts,
            encoder_deg=encoder_angle_deg(self._settings.encoder, signals.angle_deg),
            thermistor_c=signals.housing_c + warm,
        )


def _cubic(left: FloatArray, right: FloatArray, share: FloatArray, interval_s: float) -> FloatArray:
    """Return angles between grid instants, from angles (row 0) and rates (row 1) at both ends; shape (n,)."""
    step = right[0] - left[0]
    before, after = left[1] * interval_s - step, right[1] * interval_s - step
    rest = 1.0 - share
    angle: FloatArray = left[0] + share * (step + rest * (rest * before - share * after))
    return angle


def _axis_position(position: Position, along: str) -> AxisPosition:
    """Return the position of a unit of three axes; `along`: the axis that is up in the position "along"."""
    if position != "along" and position != "across":
        return position
    up: tuple[AxisPosition, ...] = ("x up", "y up", "z up")
    return up[(AXES.index(along) + (position == "across")) % 3]


OTHER_NOISE = 1 << 32
"""Added to the seed for the noise of a second gyro."""


class World:
    """The bench's physics behind `benchctl_instruments.simulated.machines`. Thread-safe.

    Computation is lazy. Motion and temperatures are known in closed form between demands, so that a jump of hours costs
    no more than one of a second; only samples run through the gyro's electronics, instant by instant. The same
    settings, demands and samples give the same volts.

    Parameters
    ----------
    clock
        Bench time.
    settings
        Settings of the bench; by default the default settings.
    effects
        Effects in addition to the baseline, by stage of `benchctl_instruments.physics.chain`.
    """

    def __init__(
        self, clock: BenchClock, settings: WorldSettings | None = None, effects: Sequence[Effect] = ()
    ) -> None:
        self.clock = clock
        self.settings = settings or WorldSettings()
        timebase = Timebase(clock, self.settings.grid_hz)
        axis = TableAxis(timebase, self.settings.table)
        sensor = sensor_of(self.settings)
        climate = ClimateChamber(
            timebase, self.settings.chamber, self.settings.room_c, coil_is_housing=sensor.coil_is_housing
        )
        self.table: TableMachine = axis
        self.chamber: ChamberMachine = climate
        self._installation = Installation(timebase)
        self.inputs: AnalogInputs = Terminals(
            timebase, self.settings, sensor, axis, climate, self._installation, effects
        )
        self._timebase, self._axis, self._climate, self._effects = timebase, axis, climate, tuple(effects)

    def power(self, on: bool) -> None:
        """Switch the gyro's supply: off, it outputs 0 V; on, it has new turn-on errors and warms up again."""
        self._installation.power(on)

    def mount(self, position: Position) -> None:
        """Mount the gyro in another position."""
        self._installation.mount(position)

    def second_gyro(self) -> GyroInputs:
        """Return the inputs of a second gyro of the same make on the same table, with its own noise.

        It has the effects up to the electronics and those of the time stamps, whose encoder's side is the digitizer's;
        other effects on samples belong to the digitizer. Reading it does not change the samples of `inputs`.
        """
        settings = replace(self.settings, seed=self.settings.seed + OTHER_NOISE)
        inside = [one for one in self._effects if one.stage in GRID_STAGES or isinstance(one, ClockEffect)]
        time = self._timebase.second()
        return Terminals(time, settings, sensor_of(settings), self._axis, self._climate, self._installation, inside)
