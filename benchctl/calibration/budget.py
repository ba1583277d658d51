"""What adds to the scatter of the data: contributions that a repetition on the same bench would not show (type B).

Each is a standard uncertainty (k = 1) in the parameter's own unit, after JCGM 100:2008 (GUM), 4.3 and 5.1. How well the
bench is known is what the recording's certificates state; what they do not is assumed, and its sentence says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchctl.calibration.earth import EARTH_DPS
from benchctl.calibration.reduce import ReducedStep
from benchctl.calibration.result import Contribution
from benchctl.recordings.model import BenchFacts
from benchctl.recordings.stated import Stated, StatedUncertainties

_ARCSEC_PER_REV = 360.0 * 3600.0


def contributions(
    name: str,
    values: Mapping[str, float],
    standard: float,
    dof: float,
    steps: Sequence[ReducedStep],
    bench: BenchFacts,
    earth_rate_dps: float,
    known: StatedUncertainties,
) -> tuple[Contribution, ...]:
    """The budget of one parameter of a joint fit: type A with its `dof`, then what matters of type B."""
    scatter = "scatter of the data, bias drift included"
    parts = [Contribution(source="type A", standard=standard, kind="A", says=scatter, dof=dof)]

    def add(source: str, amount: float, says: str) -> None:
        if amount > 0.0 and np.isfinite(amount):
            parts.append(Contribution(source=source, standard=float(amount), kind="B", says=says))

    gain = abs(values["K0_v_per_dps"])
    slope_t = values.get("g1", values.get("a1", 0.0))
    celsius, clock = known.thermometer_c.standard, known.clock_ppm.standard * 1e-6
    thermometer = f"thermistor known to {_told(known.thermometer_c, ' °C')}"
    time_base = f"clock known to {_told(known.clock_ppm, ' ppm')}"
    if name == "K0_v_per_dps":
        turns = max(sum(step.revolutions for step in steps), 1.0)
        angle = known.encoder_arcsec.standard / (_ARCSEC_PER_REV * turns)
        add("encoder", gain * angle, f"{_told(known.encoder_arcsec, '″')} over all turns")
        add("time base", gain * clock, time_base)
        add("ADC gain", gain * known.gain_ppm.standard * 1e-6, f"volts known to {_told(known.gain_ppm, ' ppm')}")
        add("thermometer", gain * abs(slope_t) * celsius, thermometer)
    elif name == "U0_v":
        add("ADC offset", known.offset_v.standard, known.offset_v.says)
        add("thermometer", abs(values.get("c1", 0.0)) * celsius, thermometer)
        add(*_earth(gain, bench, earth_rate_dps, known))
    elif name == "S_rad_per_dps":
        add("time base", abs(values[name]) * clock, time_base)
    elif name in ("g1", "a1", "c1"):
        second = {"g1": "g2", "a1": "a2", "c1": "c2"}[name]
        add("thermometer", 2 * abs(values.get(second, 0.0)) * celsius, thermometer)
    return tuple(parts)


def _earth(gain: float, bench: BenchFacts, earth_rate_dps: float, known: StatedUncertainties) -> tuple[str, float, str]:
    """Earth's rate: how well its part along the axis is known; all of it where the latitude is not."""
    if bench.latitude_deg is None:
        return "Earth's rate", gain * EARTH_DPS / np.sqrt(3.0), "latitude not known: its rate is part of U0"
    off_deg = np.hypot(known.latitude_deg.standard, known.tilt_deg.standard)
    slope = EARTH_DPS * np.cos(np.deg2rad(bench.latitude_deg)) * np.deg2rad(off_deg)
    return (
        "Earth's rate",
        gain * float(slope),
        f"{earth_rate_dps:.4f} °/s taken off; latitude to {_told(known.latitude_deg, '°')}, tilt to "
        f"{_told(known.tilt_deg, '°')}",
    )


def _told(figure: Stated, unit: str) -> str:
    """A standard uncertainty with its unit and its source."""
    return f"{figure.standard:.3g}{unit} ({figure.says})"
