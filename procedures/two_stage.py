"""The two-stage calibration of the paper, with held-out runs for verification."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import (
    POSITIVE,
    Range,
    Role,
    Sine,
    Soak,
    Step,
    levels,
    procedure,
    rates_between_zeros,
    set_points,
    whole_cycles,
)


@procedure(calibrates=True)
def two_stage(
    room_c: Annotated[float, "reference temperature T0, °C"] = 20.0,
    coldest_c: Annotated[float, "coldest set point, °C"] = -40.0,
    hottest_c: Annotated[float, "hottest set point, °C"] = 60.0,
    points: Annotated[int, "number of set points", Range(1, 1000)] = 20,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    top_rate_dps: Annotated[float, "top of the sweep for k(ω) at room temperature, °/s", POSITIVE] = 170.0,
    sweep_rates: Annotated[int, "rates of that sweep, each in both directions", Range(1, 1000)] = 17,
    rate_dps: Annotated[float, "top rate at every set point, where k(ω) is near 1, °/s", POSITIVE] = 50.0,
    rates: Annotated[int, "rates at every set point, each in both directions", Range(1, 1000)] = 5,
    sine_dps: Annotated[float, "peak rate of the sine runs, °/s", POSITIVE] = 165.0,
    sine_hz: Annotated[tuple[float, ...], "frequencies of the sine runs, Hz", POSITIVE] = (0.25, 0.5, 1.0),
    verify_hz: Annotated[tuple[float, ...], "frequencies of the sine runs kept aside, Hz", POSITIVE] = (0.4, 0.8),
    run_s: Annotated[float, "least duration of a run, s; whole revolutions, whole periods", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """k(ω) at room temperature, the slope at every set point, sine runs, and held-out sine runs for verification."""

    def sines(frequencies_hz: tuple[float, ...], role: Role) -> Iterator[Step]:
        for hz in frequencies_hz:
            yield Sine(amplitude_dps=sine_dps, frequency_hz=hz, cycles=whole_cycles(hz, run_s), role=role)

    yield Soak(setpoint_c=room_c, hold_s=soak_s)
    yield from rates_between_zeros(levels(top_rate_dps, sweep_rates), at_least_s=run_s, zero_s=zero_s)
    yield from sines(sine_hz, "fit")
    for i, setpoint_c in enumerate(set_points(coldest_c, hottest_c, points)):
        yield Soak(setpoint_c=setpoint_c, hold_s=soak_s)
        yield from rates_between_zeros(levels(rate_dps, rates), at_least_s=run_s, zero_s=zero_s)
        if i % 4 == 0 or i == points - 1:
            yield from sines(sine_hz, "fit")
        elif i % 4 == 2:
            yield from sines(verify_hz, "verify")
