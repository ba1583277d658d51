"""The gyro under test as the terminals play it: one of two laws behind one description."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from benchctl_instruments.interfaces import Position
from benchctl_instruments.physics.chain import Baseline, gyro_baseline
from benchctl_instruments.physics.gyro import earth_rate_dps, horizontal_earth_rate_dps, white_deviation_v
from benchctl_instruments.physics.mounting import mounted_across
from benchctl_instruments.physics.response_gyro import response_baseline
from benchctl_instruments.physics.turn_on import turned_on
from benchctl_instruments.simulated.settings import WorldSettings

_FORGETTING_TIME_CONSTANTS = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """What the bench needs of a gyro.

    `baseline` gives its stages on the grid, as it is mounted and as it came up when it was switched on for the n-th
    time, n from 1; `memory_s` is how long its electronics remember; `white_v` gives the standard
    deviation [V] of the white noise of samples that lie an interval [s] apart. Where `coil_is_housing` the coil is as
    warm as the housing, which the thermistor reads.
    """

    baseline: Callable[[Position, int], Baseline]
    memory_s: float
    white_v: Callable[[float], float]
    walk_v_per_sqrt_s: float
    output_limit_v: float
    T0_c: float
    coil_is_housing: bool


def sensor_of(settings: WorldSettings) -> Sensor:
    """The response where the settings state one, else the open-loop interferometer.

    A response comes up as it is stated each time, and across the table's axis it feels nothing.
    """
    response, gyro = settings.response, settings.gyro
    if response is not None:
        stages = response_baseline(response)
        return Sensor(
            baseline=lambda position, _: stages if position == "along" else mounted_across(stages, 0.0, 0.0),
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
        if position == "along":
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
