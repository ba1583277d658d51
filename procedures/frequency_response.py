"""Frequency response of the output."""

import math
from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Sine, Soak, Step, levels, procedure, rates_between_zeros, whole_cycles


@procedure()
def frequency_response(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    sine_dps: Annotated[float, "peak rate of the sines, °/s", POSITIVE] = 30.0,
    frequencies_hz: Annotated[tuple[float, ...], "sines, Hz", POSITIVE] = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0),
    acceleration_dps2: Annotated[float, "highest acceleration of the sines, °/s²", POSITIVE] = 800.0,
    rate_dps: Annotated[float, "highest rate for the scale factor, °/s", POSITIVE] = 50.0,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions, whole periods", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Bandwidth and delay: sines of several frequencies, and the scale factor as reference."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield from rates_between_zeros(levels(rate_dps, 5), at_least_s=run_s, zero_s=zero_s)
    for hz in frequencies_hz:
        amplitude_dps = min(sine_dps, acceleration_dps2 / (2 * math.pi * hz))
        yield Sine(amplitude_dps=amplitude_dps, frequency_hz=hz, cycles=whole_cycles(hz, run_s))
