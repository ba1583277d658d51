"""Printed names of the diagnosis's coordinates and units; imports nothing heavy, so that help is quick."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

from benchctl.reports import text


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """Advice for a lab engineer: the effect's consequence for a `calibration`, and what to do at the `bench`."""

    calibration: str
    bench: str


def advice_for(effect: str) -> Advice | None:
    """Return the advice for an effect; None for an effect of another package."""
    return _book().get(effect)


@lru_cache(maxsize=1)
def _book() -> Mapping[str, Advice]:
    text = files("benchctl.reports").joinpath("advice.toml").read_text(encoding="utf-8")
    return {name: Advice(**advice) for name, advice in tomllib.loads(text).items()}


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
"""Units whose printed form differs from the rule."""


def coordinate(name: str) -> str:
    """Return a coordinate in words; both of two that are joined by `*`."""
    return " together with ".join(COORDINATES.get(part, part.replace("_", " ")) for part in name.split("*"))


def unit(written: str) -> str:
    """Return a unit as printed, on one line."""
    return _UNITS.get(written) or text.unit_text(written).replace(" ", "\u00a0")
