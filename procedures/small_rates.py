"""The smallest detectable rates."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, levels, procedure, rates_between_zeros, slow_swing, small_steps


@procedure()
def small_rates(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    steps_dps: Annotated[tuple[float, ...], "small rates and changes of a rate, °/s", POSITIVE] = (
        0.002,
        0.005,
        0.01,
        0.02,
        0.05,
    ),
    base_dps: Annotated[float, "rate about which its changes are small, °/s"] = 10.0,
    small_run_s: Annotated[float, "duration of a small rate, s", POSITIVE] = 60.0,
    swing_dps: Annotated[float, "peak rate of the slow swing through zero, °/s", POSITIVE] = 0.1,
    swing_hz: Annotated[float, "its frequency, Hz", POSITIVE] = 0.01,
    rate_dps: Annotated[float, "highest rate for the scale factor, °/s", POSITIVE] = 50.0,
    run_s: Annotated[float, "least duration of its runs, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Threshold at rest, resolution at a constant rate, dead zone by a slow sine, and the scale factor as reference."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield from rates_between_zeros(levels(rate_dps, 5), at_least_s=run_s, zero_s=zero_s)
    yield from small_steps(0.0, steps_dps, run_s=small_run_s)
    yield from small_steps(base_dps, steps_dps, run_s=small_run_s)
    yield slow_swing(swing_dps, swing_hz, cycles=2)
