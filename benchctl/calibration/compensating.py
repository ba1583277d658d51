"""A `coefficients.json` ready for use: its law, its valid range, and whose it is."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchctl.calibration.applied_law import AppliedLaw
from benchctl.calibration.coefficients import coefficients_in
from benchctl.calibration.coefficients_law import By, Coefficients, applied_law, checked, is_of_law
from benchctl.calibration.result import ValidRange
from benchctl.documents import json_document
from benchctl.limits import MOST_DESCRIPTION_BYTES, read_whole, shown
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensation:
    """What compensates the output of one unit.

    Attributes
    ----------
    law, by
        The law, and whether it is that of the joint fit or of the stages.
    valid
        The measured range; a temperature that is not recorded has no bounds, −inf to inf.
    unit, output_unit
        The unit's serial, empty where the file names none, and the unit of its output.
    sha256
        Of the file's bytes.
    sources
        Name and digest of every recording that was fitted.
    k, expanded
        Coverage factor and expanded uncertainty of the law's own parameters, by their names in the file.
    error_percent
        Largest residual over the largest rate of a run, on runs that were not fitted; None where there were none.
    earth_rate_dps
        The vertical part of the Earth's rate that the sensed rate contains in addition to the table's.
    """

    law: AppliedLaw
    by: By
    valid: ValidRange
    unit: str
    output_unit: str
    sha256: str
    sources: tuple[tuple[str, str], ...]
    k: float
    expanded: Mapping[str, float]
    error_percent: float | None
    earth_rate_dps: float

    def inside(self, rate_dps: FloatArray, celsius: FloatArray) -> BoolArray:
        """Whether rate and temperature, arrays of one shape, lie where the coefficients were measured."""
        (slowest, fastest), (coldest, warmest) = self.valid.rate_dps, self.valid.temperature_c
        within = (rate_dps >= slowest) & (rate_dps <= fastest) & (celsius >= coldest) & (celsius <= warmest)
        return np.asarray(within)


def read_compensation(path: Path, by: By | None = None) -> Compensation:
    """Read coefficients for use: by the joint fit or the stages; None: by the joint fit if there is one.

    Raises
    ------
    UsageError
        The file cannot be read or used, has no such law, or does not say where it is valid.
    """
    text = read_whole(path, MOST_DESCRIPTION_BYTES, "coefficients ")
    found = checked(coefficients_in(json_document(text, f"coefficients {path}"), path), str(path))
    if by is None:
        by = "stages" if found.joint is None else "joint"
    try:
        return _compensation(found, by, hashlib.sha256(text).hexdigest())
    except UsageError as err:
        raise UsageError(f"{path}: {err}") from err


def _compensation(found: Coefficients, by: By, sha256: str) -> Compensation:
    law = applied_law(found, by)
    levels = ("joint",) if by == "joint" else ("stage_2", "stage_1")
    of_another = by == "stages" and found.joint is not None  # the file's uncertainties are those of the joint fit
    return Compensation(
        law=law,
        by=by,
        valid=_valid(found),
        unit=found.unit or "",
        output_unit=found.output_unit,
        sha256=sha256,
        sources=tuple((source.recording, source.digest) for source in found.source),
        k=found.uncertainty.k,
        expanded={
            name: parameter.expanded
            for name, parameter in found.uncertainty.parameters.items()
            if parameter.expanded is not None and is_of_law(name, law) and not of_another
        },
        error_percent=next((found.error_percent[name] for name in levels if name in found.error_percent), None),
        earth_rate_dps=found.earth_rate_dps,
    )


def _valid(found: Coefficients) -> ValidRange:
    if found.valid is None:
        raise UsageError("does not say where it is valid (`valid`); write it with `benchctl fit`")
    slowest, fastest = found.valid.rate_dps
    low, high = found.valid.temperature_c
    coldest, warmest = -math.inf if low is None else low, math.inf if high is None else high
    if not (slowest < fastest and coldest <= warmest):
        raise UsageError(
            f"`valid` is {shown([slowest, fastest])} deg/s and {shown([low, high])} °C, expected the lower end "
            "first; write it with `benchctl fit`"
        )
    return ValidRange(rate_dps=(slowest, fastest), temperature_c=(coldest, warmest))


TOLERANCE = 1e-9
"""Tolerance of another program, relative to the largest rate in `valid`: far above rounding, far below any gyro."""

_RATES, _TEMPERATURES = 7, 5
_RATES_ALONE = 25
_REACHED = 1e-6
_ROOM_C = 20.0


@dataclass(frozen=True, slots=True)
class SelfTestPoint:
    """An output [V] at a temperature [°C], and its rate [°/s], to check another program's compensation."""

    volts: float
    celsius: float
    rate_dps: float


def tolerance_dps(compensation: Compensation) -> float:
    """Return the tolerance of a self-test point, °/s."""
    return TOLERANCE * max(map(abs, compensation.valid.rate_dps))


def self_test_points(compensation: Compensation) -> list[SelfTestPoint]:
    """A grid over the valid range with its corners, 35 points; at one temperature 25.

    Raises `UsageError` where the law has no output for a rate in it: then it was not measured there.
    """
    law, valid = compensation.law, compensation.valid
    coldest, warmest = valid.temperature_c
    if not (math.isfinite(coldest) and math.isfinite(warmest)):
        coldest = warmest = law.T0_c or _ROOM_C
    several = warmest > coldest
    temperatures = np.linspace(coldest, warmest, _TEMPERATURES if several else 1)
    rates = np.linspace(*valid.rate_dps, _RATES if several else _RATES_ALONE)
    rate_dps, celsius = (grid.ravel() for grid in np.meshgrid(rates, temperatures))
    volts = law.volts(rate_dps, celsius)
    given = law.rate_dps(volts, celsius)
    missed = np.flatnonzero(~(np.abs(given - rate_dps) <= _REACHED * np.abs(valid.rate_dps).max()))
    if missed.size:
        first = missed[0]
        raise UsageError(
            f"the law has no output for {rate_dps[first]:.6g} deg/s at {celsius[first]:.6g} °C, which lies in `valid`; "
            "write the coefficients with `benchctl fit`"
        )
    return [SelfTestPoint(*map(float, point)) for point in zip(volts, celsius, given, strict=True)]
