"""What adds to the scatter of the data: contributions that a repetition on the same bench would not show (type B).

Each is a standard uncertainty (k = 1) in the parameter's own unit, after JCGM 100:2008 (GUM), 4.3 and 5.1. What the
recording states (encoder, converter, latitude) is taken from it; the rest are `Assumptions`, and their sentences say
so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchctl.calibration.earth import EARTH_DPS
from benchctl.calibration.options import Assumptions
from benchctl.calibration.reduce import ReducedStep
from benchctl.calibration.result import Contribution
from benchctl.recordings.model import BenchFacts

_ARCSEC_PER_REV = 360.0 * 3600.0


def contributions(
    name: str,
    values: Mapping[str, float],
    standard: float,
    steps: Sequence[ReducedStep],
    bench: BenchFacts,
    earth_rate_dps: float,
    assumed: Assumptions,
) -> tuple[Contribution, ...]:
    """The budget of one parameter of a joint fit: type A first, then what matters of type B."""
    parts = [
        Contribution(source="type A", standard=standard, kind="A", says="scatter of the data, bias drift included")
    ]

    def add(source: str, amount: float, says: str) -> None:
        if amount > 0.0 and np.isfinite(amount):
            parts.append(Contribution(source=source, standard=float(amount), kind="B", says=says))

    gain = abs(values["K0_v_per_dps"])
    slope_t = values.get("g1", values.get("a1", 0.0))
    step_v = 2 * bench.adc_range_v / 2.0**bench.adc_bits if bench.adc_bits and bench.adc_range_v else 0.0
    offset_v = assumed.adc_offset_v if assumed.adc_offset_v is not None else step_v / np.sqrt(12.0)
    thermometer = f"thermistor known to {assumed.thermometer_c:g} °C (assumed)"
    if name == "K0_v_per_dps":
        accuracy = bench.encoder_accuracy_arcsec / np.sqrt(3.0)
        turns = max(sum(step.revolutions for step in steps), 1.0)
        add(
            "encoder", gain * accuracy / (_ARCSEC_PER_REV * turns), f"{bench.encoder_accuracy_arcsec:g}″ over all turns"
        )
        add("time base", gain * assumed.timebase_ppm * 1e-6, f"clock known to {assumed.timebase_ppm:g} ppm (assumed)")
        add("ADC gain", gain * assumed.adc_gain_ppm * 1e-6, f"volts known to {assumed.adc_gain_ppm:g} ppm (assumed)")
        add("thermometer", gain * abs(slope_t) * assumed.thermometer_c, thermometer)
    elif name == "U0_v":
        add(
            "ADC offset",
            offset_v,
            "one step of the converter, uniform" if assumed.adc_offset_v is None else "as stated",
        )
        add("thermometer", abs(values.get("c1", 0.0)) * assumed.thermometer_c, thermometer)
        add(*_earth(gain, bench, earth_rate_dps, assumed))
    elif name == "S_rad_per_dps":
        add(
            "time base",
            abs(values[name]) * assumed.timebase_ppm * 1e-6,
            f"clock: {assumed.timebase_ppm:g} ppm (assumed)",
        )
    elif name in ("g1", "a1", "c1"):
        second = {"g1": "g2", "a1": "a2", "c1": "c2"}[name]
        add("thermometer", 2 * abs(values.get(second, 0.0)) * assumed.thermometer_c, thermometer)
    return tuple(parts)


def _earth(gain: float, bench: BenchFacts, earth_rate_dps: float, assumed: Assumptions) -> tuple[str, float, str]:
    """Earth's rate: how well its part along the axis is known; all of it where the latitude is not."""
    if bench.latitude_deg is None:
        return "Earth's rate", gain * EARTH_DPS / np.sqrt(3.0), "latitude not known: its rate is part of U0"
    slope = (
        EARTH_DPS
        * np.cos(np.deg2rad(bench.latitude_deg))
        * np.deg2rad(np.hypot(assumed.latitude_deg, assumed.tilt_deg))
    )
    return (
        "Earth's rate",
        gain * float(slope),
        f"{earth_rate_dps:.4f} °/s taken off; latitude {assumed.latitude_deg:g}° and tilt "
        f"{assumed.tilt_deg:g}° (assumed)",
    )
