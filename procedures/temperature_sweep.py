"""Scale factor and bias over temperature, from cold to hot and, optionally, back on a ramp."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, ThermalRamp, levels, procedure, rates_between_zeros, set_points


@procedure(calibrates=True)
def temperature_sweep(
    coldest_c: Annotated[float, "coldest set point, °C"] = -40.0,
    hottest_c: Annotated[float, "hottest set point, °C"] = 60.0,
    points: Annotated[int, "number of set points", Range(1, 1000)] = 20,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    rate_dps: Annotated[float, "highest rate at every set point, °/s", POSITIVE] = 50.0,
    rates: Annotated[int, "rates at every set point, each in both directions", Range(1, 1000)] = 5,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
    return_c_per_min: Annotated[float, "ramp back to the coldest set point at rest, °C/min; 0: none", Range(0)] = 0.0,
) -> Iterator[Step]:
    """Slope and bias at every set point; the ramp back shows effects of the temperature's rate and direction."""
    for setpoint_c in set_points(coldest_c, hottest_c, points):
        yield Soak(setpoint_c=setpoint_c, hold_s=soak_s)
        yield from rates_between_zeros(levels(rate_dps, rates), at_least_s=run_s, zero_s=zero_s)
    if return_c_per_min > 0:
        yield ThermalRamp(from_c=setpoint_c, to_c=coldest_c, ramp_c_per_min=return_c_per_min)
