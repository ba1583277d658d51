"""Readings in volts that nobody recorded, for the tests of what is made of them."""

from __future__ import annotations

from collections.abc import Sequence

from benchctl.metrology.stretches import Reading, Stretch

SCALE_V_PER_DPS, BIAS_V = 0.05, 0.01
LENGTH_S = 10.0


def reading(number: int, rate_dps: float, output_v: float | None = None, white_v2: float = 1e-12) -> Reading:
    """The reading of a straight gyro at a rate, ten seconds after the one before."""
    straight_v = SCALE_V_PER_DPS * rate_dps + BIAS_V
    return Reading(
        step=number + 1,
        set_dps=rate_dps,
        rate_dps=rate_dps,
        output_v=straight_v if output_v is None else output_v,
        white_v2=white_v2,
        middle_s=LENGTH_S * (number + 0.5),
        duration_s=LENGTH_S,
        temperature_c=20.0,
    )


def stretch(rates_dps: Sequence[float], first: int = 0) -> Stretch:
    """Readings at some rates, one after the other."""
    readings = tuple(reading(first + number, rate) for number, rate in enumerate(rates_dps))
    return Stretch(setpoint_c=20.0, before_c=20.0, power_on=0, across=False, readings=readings)
