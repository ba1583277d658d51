"""The gyro under test as the terminals play it: one of two laws behind one description."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from instruments.physics.chain import Baseline, gyro_baseline
from instruments.physics.gyro import earth_rate_dps, white_deviation_v
from instruments.physics.response_gyro import response_baseline
from instruments.simulated.settings import WorldSettings

_FORGETTING_TIME_CONSTANTS = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """What the bench needs of a gyro.

    `baseline` are its stages on the grid; `memory_s` is how long its electronics remember; `white_v` gives the standard
    deviation [V] of the white noise of samples that lie an interval [s] apart. Where `coil_is_housing` the coil is as
    warm as the housing, which the thermistor reads.
    """

    baseline: Baseline
    memory_s: float
    white_v: Callable[[float], float]
    walk_v_per_sqrt_s: float
    output_limit_v: float
    T0_c: float
    coil_is_housing: bool


def sensor_of(settings: WorldSettings) -> Sensor:
    """The response where the settings state one, else the open-loop interferometer."""
    response, gyro = settings.response, settings.gyro
    if response is not None:
        return Sensor(
            baseline=response_baseline(response),
            memory_s=0.0,
            white_v=lambda _: response.noise_v_rms,
            walk_v_per_sqrt_s=0.0,
            output_limit_v=response.output_limit_v,
            T0_c=response.T0_c,
            coil_is_housing=True,
        )
    return Sensor(
        baseline=gyro_baseline(gyro, earth_rate_dps(settings.latitude_deg), 1.0 / settings.grid_hz),
        memory_s=_FORGETTING_TIME_CONSTANTS / (math.sqrt(0.5) * 2.0 * math.pi * gyro.cutoff_hz),
        white_v=lambda interval_s: white_deviation_v(gyro, 1.0 / interval_s),
        walk_v_per_sqrt_s=gyro.bias_walk_v_per_sqrt_s,
        output_limit_v=gyro.output_limit_v,
        T0_c=gyro.T0_c,
        coil_is_housing=False,
    )
