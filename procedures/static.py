"""The output at rest."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Static, Step, procedure


@procedure()
def static(
    at_c: Annotated[float, "chamber, °C"] = 20.0,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    duration_s: Annotated[float, "duration, s", POSITIVE] = 3600.0,
) -> Iterator[Step]:
    """Bias, its stability and the noise: the table at rest at one temperature."""
    yield Soak(setpoint_c=at_c, hold_s=soak_s)
    yield Static(duration_s=duration_s)
