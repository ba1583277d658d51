"""The first half hour after a turn-on."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, PowerCycle, Range, Soak, Static, Step, levels, procedure, rates_between_zeros


@procedure()
def warm_up(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    off_s: Annotated[float, "time without supply, s: until the unit is as warm as the chamber", POSITIVE] = 3600.0,
    warm_s: Annotated[float, "rest after the turn-on, s", POSITIVE] = 2400.0,
    rate_dps: Annotated[float, "highest rate for the scale factor, °/s", POSITIVE] = 50.0,
    run_s: Annotated[float, "least duration of its runs, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Warm-up: rest from the moment the supply is switched on, then the scale factor."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield PowerCycle(off_s=off_s)
    yield Static(duration_s=warm_s, settle_s=0.0)
    yield from rates_between_zeros(levels(rate_dps, 5), at_least_s=run_s, zero_s=zero_s)
