"""What swinging does to the bias: rest, sines of one frequency and growing amplitude, rest again."""

import math
from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import Sine, Soak, Static, Step, procedure, whole_cycles


@procedure()
def rectification(
    at_c: Annotated[float, "chamber, °C"] = 23.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts"] = 1800.0,
    frequency_hz: Annotated[float, "frequency of the sines, Hz"] = 4.0,
    accelerations_dps2: Annotated[tuple[float, ...], "peak accelerations, °/s²"] = (100.0, 200.0, 400.0),
    run_s: Annotated[float, "least duration of a sine or a rest, s"] = 20.0,
) -> Iterator[Step]:
    """Vibration rectification: the bias while the table swings, at growing accelerations, between rests."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    for acceleration_dps2 in accelerations_dps2:
        yield Static(duration_s=run_s)
        yield Sine(
            amplitude_dps=acceleration_dps2 / (2 * math.pi * frequency_hz),
            frequency_hz=frequency_hz,
            cycles=whole_cycles(frequency_hz, run_s),
        )
    yield Static(duration_s=run_s)
