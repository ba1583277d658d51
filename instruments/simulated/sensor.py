"""The gyro under test at the digitizer's terminals: one of two models with a common description.

Its installation may change over time: mounted along or across the table's axis, its supply on or off. A position of a
unit of three axes concerns that unit: the gyro at the digitizer's terminals then stays along the table's axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.interfaces import Position
from benchctl_instruments.physics.chain import Baseline, gyro_baseline
from benchctl_instruments.physics.gyro import earth_rate_dps, horizontal_earth_rate_dps, white_deviation_v
from benchctl_instruments.physics.mounting import mounted_across
from benchctl_instruments.physics.response_gyro import response_baseline
from benchctl_instruments.physics.turn_on import turned_on
from benchctl_instruments.simulated.clock import Timebase
from benchctl_instruments.simulated.settings import WorldSettings

_ROUNDING = 1e-6
"""Tolerance, in grid intervals, for a scan to coincide with an instant of the grid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Installed:
    """The gyro from an instant of the grid on.

    It was switched on for the `times`-th time, counted from 1, at `on_since_s` of bench time; None: before the start.
    """

    since: float = -math.inf
    position: Position = "along"
    powered: bool = True
    times: int = 1
    on_since_s: float | None = None


class Installation:
    """Manual changes of the gyro. A change takes effect at an instant of the grid that was not sampled yet."""

    def __init__(self, timebase: Timebase) -> None:
        self._timebase = timebase
        self._changes = [Installed()]

    def power(self, on: bool) -> None:
        """Switch the gyro's supply; no effect if it is already in that state."""
        with self._timebase.lock:
            now = self._changes[-1]
            if on == now.powered:
                return
            since = self._next()
            changed = replace(now, since=since, powered=on)
            if on:
                changed = replace(changed, times=now.times + 1, on_since_s=since / self._timebase.grid_hz)
            self._changes.append(changed)

    def mount(self, position: Position) -> None:
        """Mount the gyro in another position."""
        with self._timebase.lock:
            self._changes.append(replace(self._changes[-1], since=self._next(), position=position))

    def over(self, first: int, last: int) -> Iterator[tuple[Installed, int, int]]:
        """Yield the installations over instants of the grid in order, each with its first and last instant."""
        ends = [*(change.since - 1 for change in self._changes[1:]), math.inf]
        for change, end in zip(self._changes, ends, strict=True):
            low, high = max(first, change.since), min(last, end)
            if low <= high:
                yield change, int(low), int(high)

    def placed(self, times_s: FloatArray) -> Iterator[tuple[Position, slice]]:
        """Yield the positions at increasing instants, shape (n,), each with its rows."""
        since = [change.since - _ROUNDING for change in self._changes]
        firsts = np.searchsorted(times_s * self._timebase.grid_hz, since).tolist()
        for change, first, last in zip(self._changes, firsts, [*firsts[1:], times_s.size], strict=True):
            if first < last:
                yield change.position, slice(first, last)

    def dead(self, times_s: FloatArray) -> BoolArray | None:
        """Return at which instants, shape (n,), the supply is off; None if it was never off."""
        if all(change.powered for change in self._changes):
            return None
        since = [change.since - _ROUNDING for change in self._changes]
        powered = np.array([change.powered for change in self._changes])
        found: BoolArray = ~powered[np.searchsorted(since, times_s * self._timebase.grid_hz, side="right") - 1]
        return found

    def _next(self) -> float:
        return math.ceil(self._timebase.now() * self._timebase.grid_hz) + 1


_FORGETTING_TIME_CONSTANTS = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """A gyro's model for the bench.

    `baseline` returns its stages on the grid for a mounting position and the n-th switch-on, n from 1; `memory_s` is
    the length of its electronics' memory; `white_v` returns the standard deviation [V] of the white noise of samples
    with an interval [s]. If `coil_is_housing`, the coil has the temperature of the housing, which the thermistor
    measures.
    """

    baseline: Callable[[Position, int], Baseline]
    memory_s: float
    white_v: Callable[[float], float]
    walk_v_per_sqrt_s: float
    output_limit_v: float
    T0_c: float
    coil_is_housing: bool


def sensor_of(settings: WorldSettings) -> Sensor:
    """Return the response if the settings state one, otherwise the open-loop interferometer.

    A response is equal at each switch-on, and senses nothing when mounted across the table's axis.
    """
    response, gyro = settings.response, settings.gyro
    if response is not None:
        stages = response_baseline(response)
        return Sensor(
            baseline=lambda position, _: mounted_across(stages, 0.0, 0.0) if position == "across" else stages,
            memory_s=0.0,
            white_v=lambda _: response.noise_v_rms,
            walk_v_per_sqrt_s=0.0,
            output_limit_v=response.output_limit_v,
            T0_c=response.T0_c,
            coil_is_housing=True,
        )

    def baseline(position: Position, times: int) -> Baseline:
        came_up = turned_on(gyro, settings.seed, times)
        along = gyro_baseline(came_up, earth_rate_dps(settings.latitude_deg), 1.0 / settings.grid_hz)
        if position != "across":
            return along
        return mounted_across(along, gyro.misalignment_mrad, horizontal_earth_rate_dps(settings.latitude_deg))

    return Sensor(
        baseline=baseline,
        memory_s=_FORGETTING_TIME_CONSTANTS / (math.sqrt(0.5) * 2.0 * math.pi * gyro.cutoff_hz),
        white_v=lambda interval_s: white_deviation_v(gyro, 1.0 / interval_s),
        walk_v_per_sqrt_s=gyro.bias_walk_v_per_sqrt_s,
        output_limit_v=gyro.output_limit_v,
        T0_c=gyro.T0_c,
        coil_is_housing=False,
    )
