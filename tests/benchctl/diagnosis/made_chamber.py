"""A heater, air, walls and draughts, stepped in short steps of time: shares nothing with the product's chain."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

GAIN_C_PER_PERCENT, TAU_S, ROOM_C = 4.0, 180.0, 24.0
_STEP_S = 0.05
_EVERY = 10
_QUANTUM_C = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What the chamber does beyond one lag of its air."""

    second_lag_s: float = 0.0
    dead_time_s: float = 0.0
    radiation: float = 0.0
    store: float = 0.0
    store_s: float = 300.0
    drift_c_per_hour: float = 0.0
    door_s: float = math.inf
    door: float = 0.0
    opened_s: tuple[tuple[float, float], ...] = ()
    """From when to when the lid is open [s]; the loss is then `opened` times as large."""
    opened: float = 1.0
    curvature: float = 0.0
    draught: float = 0.02
    """Deviation of the disturbance, K/√s."""
    extra: Callable[[float, float], float] = lambda _t, _air_c: 0.0
    """By how much anything else moves the temperature to which the air settles [K], at a time [s] and an air [°C]."""


def _power(t: float) -> float:
    for end_s, percent in ((40.0, 0.0), (300.0, 40.0), (520.0, 15.0), (760.0, 60.0), (950.0, 5.0), (1150.0, 45.0)):
        if t < end_s:
            return percent
    return 20.0


def chamber_channels(truth: Truth, seed: int, *, seconds: float = 1300.0) -> dict[str, FloatArray]:
    """Channels `time_s`, `chamber_temp_c` in steps of a thermometer, `heater_percent`, twice a second, shape (n,)."""
    draws = np.random.default_rng(seed).normal(0.0, truth.draught * math.sqrt(_STEP_S), round(seconds / _STEP_S))
    air, heat, wall = ROOM_C, 0.0, ROOM_C
    told: list[tuple[float, float, float]] = []
    for k, draught in enumerate(draws.tolist()):
        t = k * _STEP_S
        if k % _EVERY == 0:
            told.append((t, air, _power(t)))
        power = _power(t - truth.dead_time_s)
        power *= 1.0 + truth.curvature * power / 60.0
        heat = power if truth.second_lag_s == 0.0 else heat + _STEP_S * (power - heat) / truth.second_lag_s
        room = ROOM_C + truth.drift_c_per_hour * t / 3600.0
        loss = (1.0 - truth.radiation) * (air - room) * (1.0 + truth.door * (t > truth.door_s))
        loss *= truth.opened if any(begin < t < end for begin, end in truth.opened_s) else 1.0
        loss += truth.radiation * ((air + 273.15) ** 4 - (room + 273.15) ** 4) / (4 * 300.0**3)
        loss += truth.store * (air - wall) - truth.extra(t, air)
        wall += _STEP_S * (air - wall) / truth.store_s
        air += _STEP_S * (GAIN_C_PER_PERCENT * heat - loss) / TAU_S + draught
    columns = np.array(told)
    noisy = columns[:, 1] + np.random.default_rng(seed + 1).normal(0.0, 0.05, columns.shape[0])
    read = np.round(noisy / _QUANTUM_C) * _QUANTUM_C
    return {"time_s": columns[:, 0], "chamber_temp_c": read, "heater_percent": columns[:, 2]}
