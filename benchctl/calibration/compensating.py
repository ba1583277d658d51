"""A `coefficients.json` ready for use: its law, where that is valid, and what tells whose it is."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchctl.calibration.applied_law import AppliedLaw
from benchctl.calibration.coefficients import coefficients_in
from benchctl.calibration.coefficients_law import By, Coefficients, applied_law, checked, is_of_law
from benchctl.calibration.result import ValidRange
from benchctl.documents import json_document
from benchctl.limits import MOST_DESCRIPTION_BYTES, read_whole, shown
from benchctl_instruments.errors import UsageError

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensation:
    """What compensates the output of one unit.

    Attributes
    ----------
    law, by
        The law, and whether it is that of the joint fit or of the stages.
    valid
        What was measured; a temperature that nobody wrote down bounds nothing, −inf to inf.
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
        The vertical part of the Earth's rate that the sensed rate holds beside the table's.
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
