"""The diagnosis's coordinates and units as they are printed; nothing heavy is imported, so that help is quick."""

from __future__ import annotations

from collections.abc import Mapping

from benchctl.reports import text

COORDINATES: Mapping[str, str] = {
    "time": "time",
    "rate": "rate",
    "abs_rate": "|rate|",
    "rate_sign": "sense of rotation",
    "acceleration": "acceleration",
    "angle": "angle of the table",
    "gyro_temp": "gyro's temperature",
    "gyro_temp_rate": "change of the gyro's temperature",
    "chamber_temp": "chamber's temperature",
    "chamber_temp_rate": "warming of the chamber",
    "heater": "heater's power",
    "setpoint": "set point",
    "output": "output",
    "frequency": "frequency",
    "step": "number of the step",
}

_UNITS: Mapping[str, str] = {"1e-6": "ppm", "V s-0.5": "V/√s", "V s2 degree-1": "V/(°/s²)"}
"""Units that read better so than by the rule."""


def coordinate(name: str) -> str:
    """A coordinate in words; of two joined by `*` both."""
    return " together with ".join(COORDINATES.get(part, part.replace("_", " ")) for part in name.split("*"))


def unit(told: str) -> str:
    """A unit as it is printed, on one line."""
    return _UNITS.get(told) or text.unit_text(told).replace(" ", "\u00a0")
