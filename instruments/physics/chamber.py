"""A climate chamber and the gyro inside it: a set point followed at a limited ramp, then three thermal lags in series.

    set point -> profile (limited slope) -> air (τa) -> housing (τh) -> coil (τc)

When switched off, the air drifts to the room's temperature instead. The profile is piecewise linear in time, so each
temperature is a straight line plus exponentials: `advance` is exact and does not depend on how time is divided.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberParameters:
    """Lags [s], the ramp limit [°C/min] and the coefficients of the displayed power; every default is assumed.

    `self_heating_c` is the steady temperature of the gyro's housing above the air. The displayed power is the sum of
    the power that holds the air away from the room's temperature and the power that changes it.
    """

    ramp_c_per_min: float = 2.0
    air_lag_s: float = 60.0
    housing_lag_s: float = 600.0
    coil_lag_s: float = 300.0
    drift_lag_s: float = 1800.0
    self_heating_c: float = 0.0
    thermistor_noise_c: float = 0.003
    hold_percent_per_c: float = 0.6
    ramp_percent_per_c_per_min: float = 25.0

    def __post_init__(self) -> None:
        if self.ramp_c_per_min <= 0.0:
            raise UsageError(f"a ramp limit of {self.ramp_c_per_min} °C/min; give one above 0")
        lags_s = sorted((self.air_lag_s, self.housing_lag_s, self.coil_lag_s, self.drift_lag_s))
        if lags_s[0] <= 0.0:
            raise UsageError(f"a thermal lag of {lags_s[0]} s; give one above 0")
        # the closed-form solution is not valid for two equal lags
        if any(above < 1.01 * below for below, above in itertools.pairwise(lags_s)):
            raise UsageError(f"thermal lags {lags_s} s; leave at least 1 % between any two")


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberState:
    """The complete thermal state, temperatures in °C; `profile_c` is the present value of the ramp."""

    air_c: float
    housing_c: float
    coil_c: float
    profile_c: float
    setpoint_c: float
    running: bool = False


def settled(parameters: ChamberParameters, room_c: float) -> ChamberState:
    """Return the state of a chamber that has long been off."""
    gyro_c = room_c + parameters.self_heating_c
    return ChamberState(air_c=room_c, housing_c=gyro_c, coil_c=gyro_c, profile_c=room_c, setpoint_c=room_c)


def switched(state: ChamberState, on: bool) -> ChamberState:
    """Return the state after switching conditioning; when switched on, the profile starts from the air."""
    if on and not state.running:
        return replace(state, running=True, profile_c=state.air_c)
    return replace(state, running=on)


def advance(parameters: ChamberParameters, room_c: float, state: ChamberState, seconds: float) -> ChamberState:
    """Return the state `seconds` later under an unchanged set point."""
    return Forecast(parameters, room_c, state).after(seconds)


class Forecast:
    """Future states under an unchanged set point, efficient for many instants.

    The ramp, if the set point is not yet reached, and the settling after it are solved once each.
    """

    def __init__(self, parameters: ChamberParameters, room_c: float, state: ChamberState) -> None:
        self._parameters = parameters
        self._start = state
        self._target_c = state.setpoint_c if state.running else room_c
        self._lag_s = parameters.air_lag_s if state.running else parameters.drift_lag_s
        distance_c = state.setpoint_c - state.profile_c
        self._slope = math.copysign(parameters.ramp_c_per_min / 60.0, distance_c)
        self._ramp_s = distance_c / self._slope if state.running else 0.0

    def after(self, seconds: float) -> ChamberState:
        """Return the state `seconds` later."""
        if seconds <= 0.0:
            return self._start
        if self._start.running and seconds <= self._ramp_s:
            return self._ramping(seconds)
        start, courses = self._settling
        return self._state(courses, seconds - self._ramp_s, start.profile_c)

    def _ramping(self, seconds: float) -> ChamberState:
        return self._state(self._ramp, seconds, self._start.profile_c + self._slope * seconds)

    @cached_property
    def _ramp(self) -> _Courses:
        return _courses(self._parameters, self._start, self._lag_s, self._start.profile_c, self._slope)

    @cached_property
    def _settling(self) -> tuple[ChamberState, _Courses]:
        """Return the state at the end of the ramp, and the temperatures from then on."""
        start = self._ramping(self._ramp_s) if self._ramp_s > 0.0 else self._start
        if start.running:
            start = replace(start, profile_c=start.setpoint_c)
        return start, _courses(self._parameters, start, self._lag_s, self._target_c, 0.0)

    def _state(self, courses: _Courses, seconds: float, profile_c: float) -> ChamberState:
        air, housing, coil = courses
        return ChamberState(
            air_c=air.at(seconds),
            housing_c=housing.at(seconds),
            coil_c=coil.at(seconds),
            profile_c=profile_c,
            setpoint_c=self._start.setpoint_c,
            running=self._start.running,
        )


def power_percent(parameters: ChamberParameters, room_c: float, state: ChamberState) -> float:
    """Return the heating (+) or cooling (-) power [%], within ±100; estimated from the air and its slope."""
    if not state.running:
        return 0.0
    slope_c_per_min = (state.profile_c - state.air_c) / parameters.air_lag_s * 60.0
    power = parameters.hold_percent_per_c * (state.air_c - room_c)
    power += parameters.ramp_percent_per_c_per_min * slope_c_per_min
    return max(-100.0, min(100.0, power))


@dataclass(frozen=True, slots=True)
class _Course:
    """A temperature over time t: level + slope·t + Σ amplitude·exp(−t/tau)."""

    level: float
    slope: float
    decays: tuple[tuple[float, float], ...] = ()

    def behind(self, tau_s: float, start: float) -> _Course:
        """Return the output of a first-order lag with this course as input, from a start value."""
        level = self.level - self.slope * tau_s
        decays = tuple((amplitude * other_s / (other_s - tau_s), other_s) for amplitude, other_s in self.decays)
        own = start - level - sum(amplitude for amplitude, _ in decays)
        return _Course(level, self.slope, (*decays, (own, tau_s)))

    def at(self, t: float) -> float:
        return self.level + self.slope * t + sum(amplitude * math.exp(-t / tau_s) for amplitude, tau_s in self.decays)


_Courses = tuple[_Course, _Course, _Course]
"""Courses of air, housing and coil."""


def _courses(
    parameters: ChamberParameters, state: ChamberState, air_lag_s: float, drive_c: float, slope: float
) -> _Courses:
    air = _Course(drive_c, slope).behind(air_lag_s, state.air_c)
    warmed = replace(air, level=air.level + parameters.self_heating_c)
    housing = warmed.behind(parameters.housing_lag_s, state.housing_c)
    return air, housing, housing.behind(parameters.coil_lag_s, state.coil_c)
