"""The chamber, the gyro's housing with its thermistor, and the fibre coil behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.benchctl.diagnosis.foreign.linear import FloatArray, lagged
from tests.benchctl.diagnosis.foreign.motion import PAD_S
from tests.benchctl.diagnosis.foreign.plans import Steps

_DT_S = 0.1
_SLEW_C_PER_S = 0.1
_AIR_TAU_S = 25.0
_HOUSING_TAU_S = 110.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Climate:
    """True temperatures (°C) every `_DT_S`, shape (n,)."""

    time_s: FloatArray
    air_c: FloatArray
    housing_c: FloatArray

    def coil_c(self, lag_s: float) -> FloatArray:
        """The coil's temperature, which follows the housing through a first-order lag; none where `lag_s` is 0."""
        return lagged(self.housing_c, lag_s, _DT_S) if lag_s > 0 else self.housing_c

    def coil_rate_c_per_s(self, lag_s: float) -> FloatArray:
        """How fast the coil's temperature changes (°C/s)."""
        if lag_s > 0:
            return (self.housing_c - self.coil_c(lag_s)) / lag_s
        return (self.air_c - self.housing_c) / _HOUSING_TAU_S

    def at(self, values: FloatArray, time_s: FloatArray) -> FloatArray:
        """What is known on this grid at other times."""
        return np.interp(time_s, self.time_s, values)


def weather(steps: Steps) -> Climate:
    """The climate during `steps`; all is at the first set point when they begin."""
    time = np.arange(-PAD_S, steps[-1]["t_end"] + PAD_S + 2 * _DT_S, _DT_S)
    asked = np.full_like(time, steps[0]["chamber_setpoint_c"])
    before = steps[0]["chamber_setpoint_c"]
    for step in steps:
        later = time >= step["t_start"]
        gone = (time[later] - step["t_start"]) * _SLEW_C_PER_S
        change = step["chamber_setpoint_c"] - before
        asked[later] = before + np.sign(change) * np.minimum(gone, abs(change))
        before = step["chamber_setpoint_c"]
    air = lagged(asked, _AIR_TAU_S, _DT_S)
    return Climate(time_s=time, air_c=air, housing_c=lagged(air, _HOUSING_TAU_S, _DT_S))


def backlash(temperature_c: FloatArray, half_width_c: float) -> FloatArray:
    """The play operator: it follows once the slack of ± `half_width_c` is used up, and starts at the first value."""
    held = float(temperature_c[0])
    out = np.empty_like(temperature_c)
    for k, now in enumerate(temperature_c.tolist()):
        held = min(max(held, now - half_width_c), now + half_width_c)
        out[k] = held
    return out
