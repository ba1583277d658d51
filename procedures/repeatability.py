"""Repeatability from turn-on to turn-on."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, levels, procedure, turn_ons


@procedure()
def repeatability(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    cycles: Annotated[int, "turn-ons", Range(1, 1000)] = 6,
    off_s: Annotated[float, "time without supply, s", POSITIVE] = 1800.0,
    warm_s: Annotated[float, "rest after a turn-on, s", POSITIVE] = 1800.0,
    rate_dps: Annotated[float, "highest rate, °/s", POSITIVE] = 50.0,
    rates: Annotated[int, "rates, each in both directions", Range(1, 1000)] = 5,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Repeatability of scale factor and bias: a short sweep after every turn-on of the unit's supply."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield from turn_ons(levels(rate_dps, rates), cycles, off_s=off_s, warm_s=warm_s, at_least_s=run_s, zero_s=zero_s)
