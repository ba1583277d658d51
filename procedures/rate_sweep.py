"""Output against rate at one temperature."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, levels, procedure, rates_between_zeros


@procedure(calibrates=True)
def rate_sweep(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    top_rate_dps: Annotated[float, "highest rate, °/s", POSITIVE] = 170.0,
    rates: Annotated[int, "rates, evenly spaced, each in both directions", Range(1, 1000)] = 17,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
    verify: Annotated[bool, "a second sweep at rates in between, kept aside for verification"] = True,
) -> Iterator[Step]:
    """Scale factor, its nonlinearity and asymmetry: constant rates in both directions between zero readings."""
    step_dps = top_rate_dps / rates
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield from rates_between_zeros(levels(top_rate_dps, rates), at_least_s=run_s, zero_s=zero_s)
    if verify:
        between = [rate - step_dps / 2 for rate in levels(top_rate_dps, rates)[1::2]]
        yield from rates_between_zeros(between, at_least_s=run_s, zero_s=zero_s, role="verify")
