"""Stages of the chain at which an unnamed structure may act, and coordinates of which it may be a function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals, Stage
from benchctl_instruments.physics.chamber_effects.effect import ChamberStage
from benchctl_instruments.physics.drive_effects.effect import DriveStage

Span = tuple[float, float]
StructureStage = Literal["scale", "bias", "sampling", "encoder", "noise", "torque", "heat", "loss"]
OF_PARTS: Mapping[StructureStage, str] = {"torque": "drive", "heat": "chamber", "loss": "chamber"}
"""Stages of other parts than the gyro."""

SETPOINT_WAY = "setpoint_way"
"""Auxiliary signal: −1 while the chamber's set point falls, 1 while it rises, 0 while it is constant."""
CHAMBER_C = "chamber_temp_c"
"""Auxiliary signal: the temperature of the chamber's air."""
HEATER = "heater"
"""Auxiliary signal: the power of the chamber's heater, in its own unit."""
LEAST_TURNING_DPS = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class _Acts:
    """A stage: its place in the chain of its part, what it changes, its unit, and its printed form."""

    chain: Stage | DriveStage | ChamberStage
    what: str
    unit: str
    limit: float
    printed: tuple[float, str]
    equation: str
    formula: str


ACTS: Mapping[StructureStage, _Acts] = {
    "scale": _Acts(
        chain="scale",
        what="scale factor",
        unit="1",
        limit=2.0,
        printed=(100.0, "%"),
        equation="U − U0 → (U − U0)·(1 + f)",
        formula="K = K0·(1 + {f})",
    ),
    "bias": _Acts(
        chain="bias",
        what="bias",
        unit="V",
        limit=1e3,
        printed=(1e3, "mV"),
        equation="U → U + f",
        formula="U = U0 + {f}",
    ),
    "sampling": _Acts(
        chain="sensed_rate",
        what="delay of the gyro",
        unit="s",
        limit=0.1,
        printed=(1e3, "ms"),
        equation="ω(t) → ω(t − f)",
        formula="ω(t − {f})",
    ),
    "encoder": _Acts(
        chain="sampling",
        what="angle that the encoder states",
        unit="arcsec",
        limit=1e5,
        printed=(1.0, "″"),
        equation="θ → θ + f",
        formula="θ + {f}",
    ),
    "noise": _Acts(
        chain="sampling",
        what="noise",
        unit="1",
        limit=1e2,
        printed=(100.0, "%"),
        equation="σ → σ·(1 + f)",
        formula="σ·(1 + {f})",
    ),
    "torque": _Acts(
        chain="measurement",
        what="torque",
        unit="N m",
        limit=1e6,
        printed=(1.0, "N·m"),
        equation="τ → τ + f",
        formula="τ = J·dω/dt + b·ω + {f}",
    ),
    "heat": _Acts(
        chain="source",
        what="temperature to which the air settles",
        unit="K",
        limit=1e3,
        printed=(1.0, "K"),
        equation="T_room → T_room + f",
        formula="τ·dT/dt = gain·u + T_room − T + {f}",
    ),
    "loss": _Acts(
        chain="loss",
        what="heat loss of the air",
        unit="1",
        limit=100.0,
        printed=(100.0, "%"),
        equation="loss → loss·(1 + f)",
        formula="τ·dT/dt = gain·u + (T_room − T)·(1 + {f})",
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Over:
    """A coordinate: its word in a diagnosis, its unit, its printed form, and its values for signals.

    `momentary` coordinates follow the motion. At zero of a `signed` coordinate a structure changes nothing. The texts
    `directions` belong to coordinates with the values −1, 0 and 1 only: below, above and away from zero.
    """

    word: str
    unit: str
    printed: str
    phrase: str
    values: Callable[[Signals], FloatArray]
    momentary: bool = False
    signed: bool = False
    directions: tuple[str, str, str] | None = None


def _auxiliary(name: str) -> Callable[[Signals], FloatArray]:
    return lambda signals: signals.auxiliary.get(name, np.zeros_like(signals.time_s))


def direction(rate_dps: FloatArray) -> FloatArray:
    """Return the direction of the table, −1 or 1, and 0 below the least turning rate; shape (n,)."""
    return np.where(np.abs(rate_dps) >= LEAST_TURNING_DPS, np.sign(rate_dps), 0.0)


def last_sign(rate_dps: FloatArray, before: float = 0.0) -> FloatArray:
    """Return the last direction of rotation, −1, 0 or 1, shape (n,); `before` is the direction before the first row."""
    turning = np.abs(rate_dps) > LEAST_TURNING_DPS
    place = np.maximum.accumulate(np.where(turning, np.arange(rate_dps.size), -1))
    return np.where(place >= 0, np.sign(rate_dps[np.maximum(place, 0)]), before)


OVER: Mapping[str, _Over] = {
    "time": _Over(
        word="time",
        unit="s",
        printed="s",
        phrase="the time since the recording began",
        values=lambda signals: signals.time_s,
    ),
    "rate": _Over(
        word="rate",
        unit="deg s-1",
        printed="°/s",
        phrase="the rate",
        values=lambda signals: signals.rate_dps,
        momentary=True,
        signed=True,
    ),
    "abs_rate": _Over(
        word="abs_rate",
        unit="deg s-1",
        printed="°/s",
        phrase="the size of the rate",
        values=lambda signals: np.abs(signals.rate_dps),
        momentary=True,
    ),
    "rate_sign": _Over(
        word="rate_sign",
        unit="1",
        printed="",
        phrase="the direction of rotation",
        values=lambda signals: direction(signals.rate_dps),
        momentary=True,
        signed=True,
        directions=("the table turns clockwise", "the table turns counter-clockwise", "the table turns"),
    ),
    "last_sign": _Over(
        word="rate_sign",
        unit="1",
        printed="",
        phrase="the direction in which the table turned last",
        values=lambda signals: last_sign(signals.rate_dps),
        momentary=True,
        signed=True,
        directions=("the last turn was clockwise", "the last turn was counter-clockwise", "the table has turned"),
    ),
    "acceleration": _Over(
        word="acceleration",
        unit="deg s-2",
        printed="°/s²",
        phrase="the acceleration",
        values=lambda signals: signals.acceleration_dps2,
        momentary=True,
        signed=True,
    ),
    "angle": _Over(
        word="angle",
        unit="degree",
        printed="°",
        phrase="the table's angle",
        values=lambda signals: np.mod(signals.angle_deg, 360.0),
    ),
    "swing_angle": _Over(
        word="angle",
        unit="degree",
        printed="°",
        phrase="the table's angle",
        values=lambda signals: np.mod(signals.angle_deg + 180.0, 360.0) - 180.0,
        signed=True,
    ),
    "gyro_temp": _Over(
        word="gyro_temp",
        unit="degC",
        printed="°C",
        phrase="the coil's temperature",
        values=lambda signals: signals.coil_c,
    ),
    "gyro_temp_rate": _Over(
        word="gyro_temp_rate",
        unit="degC s-1",
        printed="°C/s",
        phrase="the rate of the coil's temperature",
        values=lambda signals: signals.coil_rate_c_per_s,
        signed=True,
    ),
    "chamber_temp": _Over(
        word="chamber_temp",
        unit="degC",
        printed="°C",
        phrase="the chamber's temperature",
        values=_auxiliary(CHAMBER_C),
    ),
    "heater": _Over(
        word="heater",
        unit="1",
        printed="",
        phrase="the heater's power",
        values=_auxiliary(HEATER),
    ),
    "setpoint": _Over(
        word="setpoint",
        unit="1",
        printed="",
        phrase="the way in which the chamber's set point moves",
        values=_auxiliary(SETPOINT_WAY),
        signed=True,
        directions=("the chamber's set point falls", "the chamber's set point rises", "the chamber's set point moves"),
    ),
    "output": _Over(
        word="output",
        unit="V",
        printed="V",
        phrase="the output",
        values=lambda signals: signals.output_v,
        momentary=True,
        signed=True,
    ),
}

PHRASES: Mapping[str, str] = {one.word: one.phrase for one in reversed([*OVER.values()])}
