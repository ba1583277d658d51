"""Thermal hysteresis of scale factor and bias."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, levels, procedure, rates_between_zeros, set_points


@procedure()
def thermal_hysteresis(
    coldest_c: Annotated[float, "coldest set point, °C"] = -40.0,
    hottest_c: Annotated[float, "hottest set point, °C"] = 60.0,
    points: Annotated[int, "set points on the way up; on the way down all but the ends", Range(1, 1000)] = 6,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    rate_dps: Annotated[float, "highest rate, °/s", POSITIVE] = 50.0,
    rates: Annotated[int, "rates at every set point, each in both directions", Range(1, 1000)] = 3,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Hysteresis and sensitivity in temperature: every set point is reached by heating, then by cooling."""
    upward = set_points(coldest_c, hottest_c, points)
    for setpoint_c in (*upward, *upward[-2:0:-1]):
        yield Soak(setpoint_c=setpoint_c, hold_s=soak_s)
        yield from rates_between_zeros(levels(rate_dps, rates), at_least_s=run_s, zero_s=zero_s)
