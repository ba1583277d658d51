"""Stability and noise of the output at rest."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Static, Step, levels, procedure, rates_between_zeros


@procedure()
def stability(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    rest_s: Annotated[float, "the long rest, s", POSITIVE] = 3600.0,
    rate_dps: Annotated[float, "highest rate for the scale factor, °/s", POSITIVE] = 50.0,
    run_s: Annotated[float, "least duration of its runs, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Bias, its stability and the noise terms: a long rest, and the scale factor as reference."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield from rates_between_zeros(levels(rate_dps, 5), at_least_s=run_s, zero_s=zero_s)
    yield Static(duration_s=rest_s)
