"""Changes at each switch-on of a gyro: bias and scale factor differ slightly, and the warm-up starts again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchctl_instruments.physics.chain import Effect
from benchctl_instruments.physics.effects.scale_warm_up import ScaleWarmUp
from benchctl_instruments.physics.effects.warm_up import WarmUp
from benchctl_instruments.physics.gyro import GyroParameters

_STREAM = 3
"""Index of the random stream of the seed; the first three are the sensor's noise."""


def turned_on(gyro: GyroParameters, seed: int, times: int) -> GyroParameters:
    """Return the gyro after it was switched on for the `times`-th time, counted from 1.

    Bias and scale factor are normal draws about its nominal ones, determined by the seed and the count.
    """
    draws = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM, times))).standard_normal(2)
    bias, scale = draws.tolist()
    return replace(
        gyro,
        U0_v=gyro.U0_v + gyro.turn_on_bias_v * bias,
        K0_v_per_dps=gyro.K0_v_per_dps * (1.0 + 1e-6 * gyro.turn_on_scale_ppm * scale),
    )


def warming_up_since(effects: Sequence[Effect], start_s: float) -> tuple[Effect, ...]:
    """Return the effects, with the warm-up effects starting at an instant of bench time [s]."""
    return tuple(
        replace(effect, start_s=start_s) if isinstance(effect, WarmUp | ScaleWarmUp) else effect for effect in effects
    )
