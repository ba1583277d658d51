"""Sinusoidal motion over frequency at one temperature."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Sine, Soak, Static, Step, procedure, whole_cycles


@procedure(calibrates=True)
def sine_sweep(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    amplitude_dps: Annotated[float, "peak rate, °/s", POSITIVE] = 100.0,
    frequencies_hz: Annotated[tuple[float, ...], "frequencies, Hz", POSITIVE] = (0.1, 0.2, 0.5, 1.0, 2.0),
    verify_hz: Annotated[tuple[float, ...], "frequencies kept aside for verification, Hz", POSITIVE] = (0.3, 0.7),
    run_s: Annotated[float, "least duration of a run, s; whole periods", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """Dynamic scale factor, delay and bandwidth: sines of one peak rate at several frequencies."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield Static(duration_s=zero_s)
    for hz in frequencies_hz:
        yield Sine(amplitude_dps=amplitude_dps, frequency_hz=hz, cycles=whole_cycles(hz, run_s))
    for hz in verify_hz:
        yield Sine(amplitude_dps=amplitude_dps, frequency_hz=hz, cycles=whole_cycles(hz, run_s), role="verify")
    yield Static(duration_s=zero_s)
