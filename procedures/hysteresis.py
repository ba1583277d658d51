"""Hysteresis of the output in rate."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, levels, procedure, rate_cycle


@procedure()
def hysteresis(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    top_rate_dps: Annotated[float, "highest rate, °/s", POSITIVE] = 170.0,
    rates: Annotated[int, "rates, evenly spaced", Range(1, 1000)] = 10,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Hysteresis in rate, scale factor and linearity: rates up and down again, in one direction, then in the other."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield from rate_cycle(levels(top_rate_dps, rates), at_least_s=run_s, zero_s=zero_s)
