"""A motor, a table and what rubs, integrated as a differential equation: shares nothing with the product's chain."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

FloatArray = npt.NDArray[np.float64]

INERTIA, VISCOUS = 0.05, 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What the drive does beyond J·dω/dt + b·ω = τ; SI."""

    coulomb: float = 0.0
    breakaway: float = 0.0
    creep_rad_s: float = 0.1
    drag: float = 0.0
    cogging: float = 0.0
    order: int = 12
    offset: float = 0.0
    drift_per_hour: float = 0.0
    warm_up: float = 0.0
    warm_up_s: float = 20.0
    delay_s: float = 0.0
    swing: float = 0.25
    steady: float = 0.0
    extra: Callable[[float, float, float], float] = lambda _t, _angle_deg, _rate_dps: 0.0
    """What resists beside, of time, angle and rate."""
    most: float = math.inf
    """The largest torque that the motor makes, and that its amplifier asks of it."""


def _asked(truth: Truth, t: float) -> float:
    """The motor's torque: two slow swings and a square one on top."""
    edge = 0.3 * math.tanh(8.0 * math.sin(0.55 * t + 0.4))
    asked = truth.swing * (math.sin(0.21 * t) + math.sin(1.3 * t + 1.0) + edge) + truth.steady
    return min(max(asked, -truth.most), truth.most)


def _resisting(truth: Truth, t: float, angle: float, rate: float) -> float:
    sign = math.tanh(rate / 2e-3)
    rest = (truth.coulomb + truth.breakaway * math.exp(-((rate / truth.creep_rad_s) ** 2))) * sign
    viscous = VISCOUS * (1.0 + truth.warm_up * (1.0 - math.exp(-t / truth.warm_up_s)))
    cogging = truth.cogging * math.cos(truth.order * angle - 0.7)
    return (
        viscous * rate
        + rest
        + truth.drag * rate * abs(rate)
        + cogging
        + truth.extra(t, math.degrees(angle) % 360.0, math.degrees(rate))
    )


def drive_channels(
    truth: Truth, seed: int, *, seconds: float = 90.0, rate_hz: float = 500.0, noise_nm: float = 0.01
) -> dict[str, FloatArray]:
    """Channels `time_s`, `encoder_deg` (wrapped, with 0.5″ of noise) and `torque_nm`, shape (n,)."""
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz

    def course(t: float, state: FloatArray) -> list[float]:
        return [state[1], (_asked(truth, t) - _resisting(truth, t, state[0], state[1])) / INERTIA]

    solved = solve_ivp(course, (0.0, seconds), [0.3, 0.0], t_eval=time_s, max_step=0.02, rtol=1e-6, method="LSODA")
    draws = np.random.default_rng(seed)
    torque = np.array([_asked(truth, t - truth.delay_s) for t in time_s])
    torque += truth.offset + truth.drift_per_hour * time_s / 3600.0 + draws.normal(0.0, noise_nm, time_s.size)
    torque = np.clip(torque, -truth.most, truth.most)
    angle = np.degrees(solved.y[0]) + draws.normal(0.0, 0.5 / 3600.0, time_s.size)
    return {"time_s": time_s, "encoder_deg": np.mod(angle, 360.0), "torque_nm": torque}
