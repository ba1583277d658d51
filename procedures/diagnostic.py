"""A run that excites every effect that a bench can excite."""

import math
from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import (
    POSITIVE,
    ConstantRate,
    Range,
    Sine,
    Soak,
    Static,
    Step,
    ThermalRamp,
    alternating,
    procedure,
    whole_cycles,
)

_SHARES = (0.03, 0.12, 0.33, 0.6, 0.85, 1.0)
_PERIODS = 3
_SETTLE_S = 0.3


@procedure()
def diagnostic(
    set_points_c: Annotated[tuple[float, ...], "chamber, °C; the first is its present temperature"] = (
        23.0,
        50,
        10,
        -30,
        23,
    ),
    soak_s: Annotated[float, "soak at the first set point, s; 0: none, so that a warm-up is visible", Range(0)] = 0.0,
    top_rate_dps: Annotated[float, "highest rate, °/s", POSITIVE] = 170.0,
    frequencies_hz: Annotated[tuple[float, ...], "sines, Hz", POSITIVE] = (0.15, 0.5, 1.5, 4.0, 9.0),
    acceleration_dps2: Annotated[float, "peak acceleration of the sines, °/s²", POSITIVE] = 450.0,
    run_s: Annotated[float, "duration of a constant rate, s", POSITIVE] = 4.0,
    sine_s: Annotated[float, "least duration of a sine, s; whole periods", POSITIVE] = 8.0,
    zero_s: Annotated[float, "rest at the beginning of a set point, s; an eighth after the rates", POSITIVE] = 40.0,
    ramp_c_per_min: Annotated[float, "ramps between the set points, °C/min", POSITIVE] = 2.0,
    swing_dps: Annotated[float, "peak rate of the swinging during ramps, °/s", Range(0)] = 45.0,
    swing_hz: Annotated[float, "frequency of the swinging during ramps, Hz", POSITIVE] = 0.2,
) -> Iterator[Step]:
    """Physics missing from the model: rest, rates and sines at every set point, ramps between with the table swinging.

    The sign of the first rate alternates between set points, so that the direction is not correlated with time.
    """
    if soak_s > 0:
        yield Soak(setpoint_c=set_points_c[0], hold_s=soak_s)
    for i, here_c in enumerate(set_points_c):
        if i > 0:
            yield ThermalRamp(
                from_c=set_points_c[i - 1],
                to_c=here_c,
                ramp_c_per_min=ramp_c_per_min,
                swing_dps=swing_dps,
                swing_hz=swing_hz,
            )
        yield Static(duration_s=zero_s)
        first = -1.0 if i % 2 else 1.0
        for rate_dps in alternating(first * share * top_rate_dps for share in _SHARES):
            yield ConstantRate(rate_dps=rate_dps, duration_s=run_s, settle_s=_SETTLE_S)
        yield Static(duration_s=zero_s / 8)
        for hz in frequencies_hz:
            yield Sine(
                amplitude_dps=min(0.97 * top_rate_dps, acceleration_dps2 / (2 * math.pi * hz)),
                frequency_hz=hz,
                cycles=whole_cycles(hz, max(sine_s, _PERIODS / hz)),
                settle_cycles=0,
            )
