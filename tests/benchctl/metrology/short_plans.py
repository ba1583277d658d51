"""Plans for made units, and what two kinds of unit are like: one that hardly has noise, and one that is ideal."""

from __future__ import annotations

from collections.abc import Sequence

from benchctl.plan import Sine, Soak, Step, levels, rates_between_zeros
from benchctl.plan.find import find_procedure
from tests.benchctl.metrology.made_unit import MadeUnit

QUIET = MadeUnit(white_v_per_sqrt_hz=1e-9, walk_v_per_sqrt_s=1e-11, adc_bits=32)
IDEAL = MadeUnit(
    cubic_per_dps2=0.0,
    asymmetry=0.0,
    hysteresis=0.0,
    scale_per_c=0.0,
    bias_v_per_c=0.0,
    bias_v_per_c2=0.0,
    shupe_v_s_per_c=0.0,
    thermal_scale=0.0,
    thermal_bias_v=0.0,
    turn_on_scale=0.0,
    turn_on_bias_v=0.0,
    warm_up_v=0.0,
    dead_dps=0.0,
    misalignment_rad=0.0,
    walk_v_per_sqrt_s=1e-11,
)
"""It has white noise, and no other fault."""


def soak(celsius: float = 20.0) -> Soak:
    return Soak(setpoint_c=celsius, hold_s=600.0)


def sweep(top_dps: float = 100.0, rates: int = 5, zero_s: float = 60.0) -> list[Step]:
    """Rates in both directions between two rests."""
    return list(rates_between_zeros(levels(top_dps, rates), at_least_s=30.0, zero_s=zero_s))


def sines(frequencies_hz: Sequence[float], cycles: int = 40, amplitude_dps: float = 50.0) -> list[Step]:
    return [Sine(amplitude_dps=amplitude_dps, frequency_hz=hz, cycles=cycles) for hz in frequencies_hz]


def procedure(name: str, **parameters: object) -> tuple[Step, ...]:
    """The steps of one of our procedures."""
    return find_procedure(name).expand({key: str(value) for key, value in parameters.items()}).steps
