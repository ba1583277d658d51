"""A `coefficients.json` ready for use: its law, its valid range, its unit; exported.

`benchctl export --to json` writes the compensation for programs that read JSON, without the details of the fit:

| key | content |
|---|---|
| `schema` | `benchctl-compensation/1` |
| `law`, `formula` | `sine`, `polynomial` or `response`, and the formula of the rate, in words |
| `K0_v_per_dps`, `U0_v`, `T0_c` | scale factor, output at rest, reference of ΔT (null: temperature has no influence) |
| `U0_T` | coefficients of ΔT, ΔT², … of the bias, V/°C^i |
| `S_rad_per_dps` | of the sine, else null |
| `stages` | list: `k_T` (of ΔT, ΔT², …) and `k_omega` (of ω², ω⁴, …), as the formula uses them |
| `discovered` | what is subtracted from U first, if a diagnosis found it: see below |
| `delay_s` | a rate applies to its output's time minus this |
| `earth_rate_dps` | the Earth's part of the sensed rate, if the calibration's latitude was known |
| `valid` | ranges `rate_dps` and `temperature_c` that were measured; null: not recorded |
| `uncertainty` | `k`; `expanded` by parameter: `c1` of `U0_T[0]`, `g1` or `a1` of `k_T[0]`, `b2` of `k_omega[0]` |
| `error_percent` | largest residual over largest rate, on runs that were not fitted, or null |
| `unit`, `output_unit` | serial; the output's unit if it is a rate and not V, as the names suggest |
| `source`, `coefficients_sha256` | digests of the recordings that were fitted, and of the file |
| `self_test` | `columns`, `points` and `tolerance_dps`: a program with a larger error at a point is wrong |

`discovered` is present if structures without a name are compensated, too: `U0_v`, and a list `structures` with `name`,
`acts_on` (`scale` or `bias`), `over` and `times` (coordinates), `formula` and `parameters`. The law's `formula` is then
applied to the corrected output, U0_v + (U − Σ f_bias − U0_v)/Π(1 + f_scale); each f is evaluated at the resulting rate.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchctl.atomic import whole_file
from benchctl.calibration.axes_compensation import AxesCompensation, axes_compensation
from benchctl.calibration.coefficients import (
    By,
    Coefficients,
    FromFile,
    applied_law,
    checked,
    coefficients_in,
    from_file,
    is_of_law,
    is_of_three_axes,
)
from benchctl.calibration.discovered import Discovered
from benchctl.calibration.model import AppliedLaw
from benchctl.calibration.result import ValidRange
from benchctl.documents import json_document
from benchctl.limits import MOST_DESCRIPTION_BYTES, read_whole
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.structure_shapes import SHAPES


@dataclass(frozen=True, slots=True, kw_only=True)
class Compensation(FromFile):
    """The compensation for the output of one unit.

    Attributes
    ----------
    law, by
        The law, and whether it is that of the joint fit or of the stages.
    output_unit
        The unit of the output.
    error_percent
        Largest residual over the largest rate of a run, on runs that were not fitted; None if there were none.
    earth_rate_dps
        The vertical part of the Earth's rate that the sensed rate contains in addition to the table's.
    """

    law: AppliedLaw
    by: By
    output_unit: str
    error_percent: float | None
    earth_rate_dps: float

    @property
    def words(self) -> str:
        """Name the law for people."""
        return f"law {self.law.name} of the {'joint fit' if self.by == 'joint' else 'stages'}"

    @property
    def delay_s(self) -> float | None:
        """A rate belongs to its output's time minus this."""
        return self.law.delay_s

    def rates_dps(self, outputs: FloatArray, celsius: FloatArray) -> FloatArray:
        """Return the rates, shape (1, n), for outputs, shape (1, n), at temperatures (n,)."""
        return self.law.rate_dps(outputs[0], celsius)[np.newaxis]


def read_compensation(path: Path, by: By | None = None) -> Compensation | AxesCompensation:
    """Read coefficients for use: by the joint fit or the stages; None: by the joint fit if there is one.

    Those of three axes have only one law.

    Raises
    ------
    UsageError
        If the file cannot be read or used, has no such law, or does not state its valid range.
    """
    text = read_whole(path, MOST_DESCRIPTION_BYTES, "coefficients ")
    content, sha256 = json_document(text, f"coefficients {path}"), hashlib.sha256(text).hexdigest()
    if is_of_three_axes(content):
        if by is not None:
            raise UsageError(f"{path}: coefficients of three axes have one law; leave out the choice of {by!r}")
        return axes_compensation(content, path, sha256)
    found = checked(coefficients_in(content, path), str(path))
    if by is None:
        by = "stages" if found.joint is None else "joint"
    try:
        return _compensation(found, by, sha256)
    except UsageError as err:
        raise UsageError(f"{path}: {err}") from err


def _compensation(found: Coefficients, by: By, sha256: str) -> Compensation:
    law = applied_law(found, by)
    levels = ("joint",) if by == "joint" else ("stage_2", "stage_1")
    of_another = by == "stages" and found.joint is not None  # the file's uncertainties are those of the joint fit
    common = from_file(found, sha256)
    own = {name: value for name, value in common["expanded"].items() if is_of_law(name, law) and not of_another}
    return Compensation(
        **{**common, "expanded": own},
        law=law,
        by=by,
        output_unit=found.output_unit,
        error_percent=next((found.error_percent[name] for name in levels if name in found.error_percent), None),
        earth_rate_dps=found.earth_rate_dps,
    )


TOLERANCE = 1e-9
"""Tolerance of another program, relative to the largest rate in `valid`: far above rounding, far below any gyro."""

_RATES, _TEMPERATURES = 7, 5
_RATES_ALONE = 25
_FINE = 15
_REACHED = 1e-6
_ROOM_C = 20.0


@dataclass(frozen=True, slots=True)
class SelfTestPoint:
    """An output [V] at a temperature [°C], and its rate [°/s], to check another program's compensation."""

    volts: float
    celsius: float
    rate_dps: float


def tolerance_dps(valid: ValidRange) -> float:
    """Return the tolerance of a self-test point, °/s."""
    return TOLERANCE * max(map(abs, valid.rate_dps))


def self_test_points(compensation: Compensation) -> list[SelfTestPoint]:
    """Return a grid over the valid range, corners included: 35 points, 25 at one temperature, 225 with structures.

    Raises `UsageError` if the law has no output for a rate in the range: then it was not measured there.
    """
    law, valid = compensation.law, compensation.valid
    coldest, warmest = valid.temperature_c
    if not (math.isfinite(coldest) and math.isfinite(warmest)):
        coldest = warmest = law.T0_c or _ROOM_C
    several = warmest > coldest
    fine = bool(law.discovered)  # local structures must be visible
    temperatures = np.linspace(coldest, warmest, (_FINE if fine else _TEMPERATURES) if several else 1)
    rates = np.linspace(*valid.rate_dps, _FINE if fine else _RATES if several else _RATES_ALONE)
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


SCHEMA = "benchctl-compensation/1"

_INDICATED = "x = (U - U0_v - sum of U0_T[i] * dT**(i + 1)) / K0_v_per_dps with dT = T - T0_c"
_FACTORS = "k_T = 1 + sum of stage.k_T[i] * dT**(i + 1)"
_BENT = "k_omega(w) = 1 + sum of stage.k_omega[i] * w**(2 * i + 2)"
FORMULAS = {
    "sine": f"{_INDICATED}; {_FACTORS}; rate = asin(S_rad_per_dps * x / k_T) / S_rad_per_dps",
    "polynomial": f"{_INDICATED}; rate = x; for each stage in turn: {_FACTORS}, {_BENT}, rate = rate * k_T * "
    "k_omega(rate)",
    "response": f"{_INDICATED}; {_FACTORS}; {_BENT}; rate is the solution nearest to 0 of rate * k_omega(rate) = "
    "x / k_T",
}
"""Law -> the formula of the rate for an output U at a temperature T [degC]."""


def compensation_json(compensation: Compensation | AxesCompensation) -> dict[str, Any]:
    """Return the content; raise `UsageError` if the law has no output for a rate in `valid`, or is of three axes."""
    if isinstance(compensation, AxesCompensation):
        raise UsageError("coefficients of three axes: coefficients.json itself states `law` and its numbers; read that")
    law = compensation.law
    points = self_test_points(compensation)
    return {
        "schema": SCHEMA,
        "unit": compensation.unit,
        "output_unit": compensation.output_unit,
        "law": law.name,
        "formula": FORMULAS[law.name],
        "rate_is": "sensed, in deg/s: that of the case and the part of the Earth's along the axis",
        "K0_v_per_dps": law.K0_v_per_dps,
        "U0_v": law.U0_v,
        "T0_c": law.T0_c if law.knows_temperature else None,
        "U0_T": list(law.bias),
        "S_rad_per_dps": law.S_rad_per_dps if law.name == "sine" else None,
        "stages": [{"k_T": list(stage.k_t), "k_omega": list(stage.k_omega)} for stage in law.stages],
        **({"discovered": _written(law.discovered)} if law.discovered else {}),
        "delay_s": law.delay_s,
        "earth_rate_dps": compensation.earth_rate_dps,
        "valid": {
            "rate_dps": list(compensation.valid.rate_dps),
            "temperature_c": [end if math.isfinite(end) else None for end in compensation.valid.temperature_c],
        },
        "uncertainty": {"k": compensation.k, "expanded": dict(compensation.expanded)},
        "error_percent": compensation.error_percent,
        "source": [{"recording": name, "digest": digest} for name, digest in compensation.sources],
        "coefficients_sha256": compensation.sha256,
        "self_test": {
            "columns": ["volts", "celsius", "rate_dps"],
            "points": [[point.volts, point.celsius, point.rate_dps] for point in points],
            "tolerance_dps": tolerance_dps(compensation.valid),
        },
    }


def _written(discovered: Discovered) -> dict[str, Any]:
    structures = [
        {
            "name": name,
            "acts_on": one.acts_on,
            "over": one.over,
            "times": one.times,
            "formula": SHAPES[one.shape].written(one.over, one.times),
            "parameters": one.values,
        }
        for name, one in discovered.structures.items()
    ]
    return {"U0_v": discovered.U0_v, "structures": structures}


def export_json(compensation: Compensation | AxesCompensation, path: Path) -> None:
    """Write the file atomically; raise `UsageError` if the law is not suitable or the disk cannot be written."""
    text = json.dumps(compensation_json(compensation), indent=1, ensure_ascii=False, allow_nan=False)
    with whole_file(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8", newline="\n")
