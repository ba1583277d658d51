"""Bias while the temperature changes."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, ThermalRamp, levels, procedure, rates_between_zeros


@procedure()
def thermal_ramps(
    from_c: Annotated[float, "temperature at both ends, °C"] = 0.0,
    to_c: Annotated[float, "temperature between, °C"] = 40.0,
    soak_s: Annotated[float, "time at every end, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    ramp_c_per_min: Annotated[float, "up and down, °C/min", POSITIVE] = 1.0,
    rate_dps: Annotated[float, "highest rate for the scale factor, °/s", POSITIVE] = 50.0,
    run_s: Annotated[float, "least duration of its runs, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Bias over the rate of temperature (Shupe): ramps at rest, up and down, and the scale factor as reference."""
    yield Soak(setpoint_c=from_c, hold_s=soak_s)
    yield from rates_between_zeros(levels(rate_dps, 5), at_least_s=run_s, zero_s=zero_s)
    yield ThermalRamp(from_c=from_c, to_c=to_c, ramp_c_per_min=ramp_c_per_min)
    yield Soak(setpoint_c=to_c, hold_s=soak_s)
    yield ThermalRamp(from_c=to_c, to_c=from_c, ramp_c_per_min=ramp_c_per_min)
