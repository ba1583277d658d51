"""The chamber of the simulated bench and the temperatures of the gyro inside, over time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber import (
    ChamberParameters,
    ChamberState,
    Forecast,
    power_percent,
    settled,
    switched,
)
from benchctl_instruments.simulated.clock import Timebase

_LONG_AGO_S = -100.0


@dataclass(frozen=True, slots=True)
class GyroTemperatures:
    """Housing and coil [°C] and the time derivative of the coil's temperature [°C/s], each of shape (n,)."""

    housing_c: FloatArray
    coil_c: FloatArray
    coil_rate_c_per_s: FloatArray


@dataclass(frozen=True, slots=True)
class _Change:
    """A command that acts from `start_s` on: the state after it, and the forecast from there."""

    start_s: float
    state: ChamberState
    then: Forecast


class ClimateChamber:
    """A `ChamberMachine`. Commands are acknowledged at once and take effect at the next full second.

    Temperatures and their derivatives are exact at full seconds and linear in between, so that they do not depend on
    the times of queries. If `coil_is_housing`, the gyro's coil has the temperature of its housing.
    """

    def __init__(
        self, timebase: Timebase, parameters: ChamberParameters, room_c: float, *, coil_is_housing: bool = False
    ) -> None:
        self._timebase = timebase
        self._parameters = parameters
        self._room_c = room_c
        self._coil_is_housing = coil_is_housing
        self._changes = [self._from(_LONG_AGO_S, settled(parameters, room_c))]
        self._seconds: dict[float, ChamberState] = {}  # the latest full seconds, each of which is used several times

    def air_c(self) -> float:
        """Return the present air temperature."""
        return self._now().air_c

    def setpoint_c(self) -> float:
        """Return the last commanded set point."""
        return self._changes[-1].state.setpoint_c

    def set_setpoint(self, setpoint_c: float) -> None:
        """Set a new set point."""
        self._change(lambda state: replace(state, setpoint_c=setpoint_c))

    def power_percent(self) -> float:
        """Return the present heating (+) or cooling (-) power, -100 to 100."""
        return power_percent(self._parameters, self._room_c, self._now())

    def running(self) -> bool:
        """Return whether conditioning was last commanded on."""
        return self._changes[-1].state.running

    def run(self, on: bool) -> None:
        """Switch conditioning on or off."""
        self._change(lambda state: switched(state, on))

    def gyro(self, times_s: FloatArray) -> GyroTemperatures:
        """Return the gyro's temperatures at instants of shape (n,), in increasing order."""
        with self._timebase.lock:
            first, last = math.floor(times_s[0]), math.ceil(times_s[-1])
            seconds = np.arange(first, max(last, first + 1) + 1, dtype=np.float64)
            states = self._states(seconds.tolist())
        housing = np.array([state.housing_c for state in states])
        housing_c = np.interp(times_s, seconds, housing)
        if self._coil_is_housing:
            warmed = np.array([state.air_c + self._parameters.self_heating_c for state in states])
            rates = (warmed - housing) / self._parameters.housing_lag_s
            return GyroTemperatures(housing_c, housing_c, np.interp(times_s, seconds, rates))
        coil_c = np.interp(times_s, seconds, np.array([state.coil_c for state in states]))
        rate = housing_c - coil_c
        rate *= 1.0 / self._parameters.coil_lag_s
        return GyroTemperatures(housing_c, coil_c, rate)

    def air(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the air [°C] and the direction of its set point, −1, 0 or 1, at increasing instants; shape (n,)."""
        with self._timebase.lock:
            seconds = np.arange(math.floor(times_s[0]), math.ceil(times_s[-1]) + 2, dtype=np.float64)
            states = self._states(seconds.tolist())
        ways = [(state.setpoint_c > state.profile_c) - (state.setpoint_c < state.profile_c) for state in states]
        moving = np.array([way * state.running for way, state in zip(ways, states, strict=True)], dtype=np.float64)
        air_c = np.interp(times_s, seconds, np.array([state.air_c for state in states]))
        return air_c, moving[(times_s - seconds[0]).astype(np.int64)]

    def _now(self) -> ChamberState:
        with self._timebase.lock:
            return self._at(self._timebase.now())

    def _states(self, seconds: list[float]) -> list[ChamberState]:
        """Return the states at full seconds, which are cached for the next call."""
        known = self._seconds
        self._seconds = {second: known.get(second) or self._at(second) for second in seconds}
        return list(self._seconds.values())

    def _at(self, time_s: float) -> ChamberState:
        known_s = self._changes[0].start_s
        if time_s < known_s:
            raise UsageError(
                f"temperatures at {time_s:.3f} s are forgotten, they are known since {known_s:.3f} s;"
                " hold the history before the next command"
            )
        change = next(change for change in reversed(self._changes) if change.start_s <= time_s)
        return change.then.after(time_s - change.start_s)

    def _from(self, start_s: float, state: ChamberState) -> _Change:
        return _Change(start_s, state, Forecast(self._parameters, self._room_c, state))

    def _change(self, change: Callable[[ChamberState], ChamberState]) -> None:
        with self._timebase.lock:
            at_s = float(math.ceil(self._timebase.now()))
            changed = change(self._at(at_s))
            past = sum(entry.start_s <= self._timebase.forgettable_s() - 1.0 for entry in self._changes)
            kept = [entry for entry in self._changes[max(past - 1, 0) :] if entry.start_s < at_s]
            self._changes = [*kept, self._from(at_s, changed)]
            self._seconds = {}
