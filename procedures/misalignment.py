"""Misalignment of the input axis."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, across, levels, procedure, rates_between_zeros


@procedure()
def misalignment(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    rate_dps: Annotated[float, "highest rate along the axis, for the scale factor, °/s", POSITIVE] = 50.0,
    across_dps: Annotated[float, "highest rate across the axis, °/s", POSITIVE] = 100.0,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Misalignment: the scale factor, then rates with the unit mounted across the table's axis by the operator."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield from rates_between_zeros(levels(rate_dps, 5), at_least_s=run_s, zero_s=zero_s)
    yield from across(levels(across_dps, 3), at_least_s=run_s, zero_s=zero_s)
