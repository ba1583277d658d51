"""Points by which another program's compensation is held against ours: outputs, temperatures, the rates they mean."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchctl.calibration.compensating import Compensation
from benchctl_instruments.errors import UsageError

TOLERANCE = 1e-9
"""How far another program may be off, of the largest rate in `valid`: far above rounding, far below any gyro."""

_RATES, _TEMPERATURES = 7, 5
_RATES_ALONE = 25
_REACHED = 1e-6
_ROOM_C = 20.0


@dataclass(frozen=True, slots=True)
class SelfTestPoint:
    """An output [V] at a temperature [°C], and the rate [°/s] that it means."""

    volts: float
    celsius: float
    rate_dps: float


def tolerance_dps(compensation: Compensation) -> float:
    """How far a point may be missed, °/s."""
    return TOLERANCE * max(map(abs, compensation.valid.rate_dps))


def self_test_points(compensation: Compensation) -> list[SelfTestPoint]:
    """A grid over the valid range with its corners, 35 points; at one temperature 25.

    Raises `UsageError` where the law has no output for a rate in it: then it was not measured there.
    """
    law, valid = compensation.law, compensation.valid
    coldest, warmest = valid.temperature_c
    if not (math.isfinite(coldest) and math.isfinite(warmest)):
        coldest = warmest = law.T0_c or _ROOM_C
    several = warmest > coldest
    temperatures = np.linspace(coldest, warmest, _TEMPERATURES if several else 1)
    rates = np.linspace(*valid.rate_dps, _RATES if several else _RATES_ALONE)
    rate_dps, celsius = (grid.ravel() for grid in np.meshgrid(rates, temperatures))
    volts = law.volts(rate_dps, celsius)
    given = law.rate_dps(volts, celsius)
    missed = np.flatnonzero(~(np.abs(given - rate_dps) <= _REACHED * np.abs(valid.rate_dps).max()))
    if missed.size:
        first = missed[0]
        raise UsageError(
            f"the law has no output for {rate_dps[first]:.6g} deg/s at {celsius[first]:.6g} °C, which lies in `valid`; "
            "write the coefficients with `benchctl fit`"
        )
    return [SelfTestPoint(*map(float, point)) for point in zip(volts, celsius, given, strict=True)]
