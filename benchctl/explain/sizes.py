"""Usual sizes of effects: as drawn by the sealed trials of `benchctl prove`, on one typical unit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from benchctl.proof.sizes import DRAWN, drawn_size
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.physics.gyro import GyroParameters

K0_V_PER_DPS, RANGE_DPS, NOISE_V = 0.05, 200.0, 1.5e-3
"""The typical unit: 10 V at 200 °/s, and a white noise per sample that is common in trials."""


@dataclass(frozen=True, slots=True)
class _TypicalUnit:
    """The typical unit; its converter has 16 bits over ±10 V."""

    gyro: GyroParameters
    range_dps: float = RANGE_DPS
    full_scale_v: float = K0_V_PER_DPS * RANGE_DPS
    noise_v: float = NOISE_V
    sample_rate_hz: float = 125.0
    adc_step_v: float = 20.0 / 2**16


_DRAWS = 400
_UNSIZED = ("phase", "choice")


@cache
def usual_sizes(identifier: str) -> dict[str, tuple[float, float]]:
    """Return lowest and highest usual size of each parameter, without sign; empty if no trial draws the effect."""
    return {
        name: (_rounded(float(sizes.min())), _rounded(float(sizes.max())))
        for name, sizes in _drawn(identifier).items()
        if effects()[identifier].parameters[name].role not in _UNSIZED
    }


def _drawn(identifier: str) -> dict[str, np.ndarray]:
    if identifier not in DRAWN:
        return {}
    rng, unit = np.random.default_rng(0), _TypicalUnit(GyroParameters(K0_v_per_dps=K0_V_PER_DPS))
    draws = [drawn_size(identifier, rng, unit) for _ in range(_DRAWS)]
    return {name: np.abs([draw[name] for draw in draws]) for name in draws[0]}


def _rounded(value: float) -> float:
    return float(f"{value:.2g}")
