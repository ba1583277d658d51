"""What acts on the gyro at each moment: the coordinates in which every effect is written."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.benchctl.diagnosis.foreign.climate import Climate, backlash
from tests.benchctl.diagnosis.foreign.linear import FloatArray, base_excited
from tests.benchctl.diagnosis.foreign.motion import Motion
from tests.benchctl.diagnosis.foreign.truth import Effects


@dataclass(frozen=True, slots=True, kw_only=True)
class Felt:
    """Time (s), rate (°/s), acceleration (°/s²), angle (°), coil's temperature above T0 (°C), its rate (°C/s).

    `slack_c` is the play of the temperature less the temperature (°C), 0 where there is no hysteresis; `supply_v` is
    the supply less its nominal voltage (V), 0 where it is not recorded.
    """

    time_s: FloatArray
    rate_dps: FloatArray
    accel_dps2: FloatArray
    angle_deg: FloatArray
    warmer_c: FloatArray
    warms_c_per_s: FloatArray
    slack_c: FloatArray
    supply_v: FloatArray


def felt(
    effects: Effects, motion: Motion, climate: Climate, supply_v: FloatArray | None, *, t0_c: float, earth_dps: float
) -> Felt:
    """What the gyro feels, on the grid of `motion`; `supply_v` is known on it too."""
    time = motion.time_s
    rate, accel = motion.rate_dps + earth_dps, motion.accel_dps2
    if mount := effects.get("mount_resonance"):
        rate = base_excited(rate, mount["frequency_hz"], mount["damping"], motion.dt_s)
        accel = np.gradient(rate, motion.dt_s)
    lag = effects.get("thermal_lag", {}).get("tau_s", 0.0)
    coil = climate.coil_c(lag)
    slack = np.zeros_like(coil)
    if play := effects.get("thermal_hysteresis"):
        slack = backlash(coil, play["width_c"]) - coil
    return Felt(
        time_s=time,
        rate_dps=rate,
        accel_dps2=accel,
        angle_deg=motion.angle_deg,
        warmer_c=climate.at(coil, time) - t0_c,
        warms_c_per_s=climate.at(climate.coil_rate_c_per_s(lag), time),
        slack_c=climate.at(slack, time),
        supply_v=np.zeros_like(time) if supply_v is None else supply_v,
    )
