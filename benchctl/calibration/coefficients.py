"""`coefficients.json`: write it according to its specification, read it back, and compensate with it.

| key | content |
|---|---|
| `schema` | `benchctl-coefficients/1` |
| `convention`, `argument` | of the stages: `correction` of the `indicated` rate (a foreign file may state another) |
| `K0_v_per_dps`, `U0_v`, `T0_c` | those of the last stage |
| `output_unit` | `V`; `deg/s` for a digital gyro: K0 is then the stated rate over the true, U0 a rate in deg/s |
| `stages` | list: `k_T`, `k_omega` (`coefficients`, `covariance`), `K0_v_per_dps`, `U0_v`, `U0_T`, `delay_s`, … |
| `valid` | ranges `rate_dps` and `temperature_c` that were measured |
| `uncertainty` | at the level of k = 2, 95.45 %: by parameter of the joint fit `expanded`, the factor `k` for its |
|               | degrees of freedom `dof` (null: infinite), and its budget by contributor |
| `source` | digests of the recordings |
| `error_percent`, `rms_percent` | per level, on runs that were not fitted |
| `joint` | the joint fit: law, convention, argument, parameters, covariance |

k_T is 1 + Σ c_i·(T − T0)^i, k_omega 1 + Σ c_i·x^(2i), x the input of its stage.

A table of static points has one temperature, and therefore one response stage by the sine law.

Every number of the law in a file is validated.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from benchctl.atomic import whole_file
from benchctl.calibration.discovered import discovered_in
from benchctl.calibration.free_motion import FreeMotionFit
from benchctl.calibration.model import AppliedLaw, Factors
from benchctl.calibration.result import (
    CalibrationResult,
    FittedParameter,
    JointFit,
    LawName,
    PolynomialFactor,
    Stage,
    ValidRange,
)
from benchctl.calibration.static_points_fit import PointsFit, StaticPointsResult
from benchctl.calibration.uncertainty import LEVEL, coverage_factor
from benchctl.documents import json_values, read_json
from benchctl.limits import listed, shown
from benchctl.recordings.import_open import first_fault
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

By = Literal["joint", "stages"]

_MOST_TERMS = 16
_MOST_STAGES = 8
_MOST_SOURCES = 1000
_TERM = re.compile(r"([abcg])(\d{1,2})")

_Terms = Annotated[list[float], Field(max_length=_MOST_TERMS)]
_Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
_Matrix = Annotated[list[_Vector], Field(min_length=3, max_length=3)]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Factor(_Part):
    coefficients: _Terms


class _Stage(_Part):
    k_t: _Factor = Field(alias="k_T")
    k_omega: _Factor
    U0_T: _Terms = []
    delay_s: float = 0.0


class _Parameter(_Part):
    value: float


class _Joint(_Part):
    law: LawName
    parameters: dict[str, _Parameter]


class _Valid(_Part):
    rate_dps: Annotated[list[float], Field(min_length=2, max_length=2)]
    temperature_c: Annotated[list[float | None], Field(min_length=2, max_length=2)]


class _Expanded(_Part):
    expanded: float | None = None


class _Uncertainty(_Part):
    k: float = 2.0
    parameters: dict[str, _Expanded] = {}


class _Source(_Part):
    recording: str
    digest: str


class _Discovered(_Part):
    U0_v: float
    structures: Annotated[dict[str, dict[str, float]], Field(max_length=_MOST_STAGES)]


class Coefficients(_Part):
    """The content of the file that compensation needs; other keys are not checked."""

    unit: str | None = None
    output_unit: str = "V"
    convention: Literal["correction", "response"]
    K0_v_per_dps: float
    U0_v: float
    T0_c: float | None
    stages: Annotated[list[_Stage], Field(min_length=1, max_length=_MOST_STAGES)]
    joint: _Joint | None = None
    valid: _Valid | None = None
    uncertainty: _Uncertainty = _Uncertainty()
    source: Annotated[list[_Source], Field(max_length=_MOST_SOURCES)] = []
    error_percent: dict[str, float | None] = {}
    earth_rate_dps: float = 0.0
    discovered: _Discovered | None = None


class AxesCoefficients(_Part):
    """The same of a unit of three axes."""

    unit: str | None = None
    T0_c: float
    matrix: _Matrix
    bias_dps: _Vector
    matrix_per_c: _Matrix = [[0.0] * 3] * 3
    bias_dps_per_c: _Vector = [0.0] * 3
    valid: _Valid | None = None
    uncertainty: _Uncertainty = _Uncertainty()
    source: Annotated[list[_Source], Field(max_length=_MOST_SOURCES)] = []


_Checked = TypeVar("_Checked", bound=_Part)


def checked_as(model: type[_Checked], content: Mapping[str, Any], where: str) -> _Checked:
    """Validate the types of the content; raise a `UsageError` that begins with `where` if they are wrong."""
    try:
        return model.model_validate(content)
    except ValidationError as err:
        raise UsageError(f"{where}: {first_fault(err)}; write it with `benchctl fit`") from err


def checked(content: Mapping[str, Any], where: str) -> Coefficients:
    """Do the same for coefficients of one axis."""
    return checked_as(Coefficients, content, where)


def _valid_range(found: Coefficients | AxesCoefficients) -> ValidRange:
    """Return the measured range; a temperature that is not recorded has no bounds. `UsageError` if there is none."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class FromFile:
    """What the compensations of one and of three axes have in common: the facts of a file of coefficients.

    Attributes
    ----------
    valid
        The measured range; a temperature that is not recorded has no bounds, −inf to inf.
    unit
        The unit's serial, empty if the file names none.
    sha256
        Digest of the file's bytes.
    sources
        Name and digest of every recording that was fitted.
    k, expanded
        Coverage factor and expanded uncertainty of the law's parameters, by their names in the file.
    """

    valid: ValidRange
    unit: str
    sha256: str
    sources: tuple[tuple[str, str], ...]
    k: float
    expanded: Mapping[str, float]


def from_file(found: Coefficients | AxesCoefficients, sha256: str) -> dict[str, Any]:
    """Return the fields of `FromFile`; raise `UsageError` if the file does not state its range."""
    parameters = found.uncertainty.parameters.items()
    return {
        "valid": _valid_range(found),
        "unit": found.unit or "",
        "sha256": sha256,
        "sources": tuple((source.recording, source.digest) for source in found.source),
        "k": found.uncertainty.k,
        "expanded": {name: one.expanded for name, one in parameters if one.expanded is not None},
    }


def applied_law(found: Coefficients, by: By) -> AppliedLaw:
    """Return the law of the joint fit or of the stages; raise `UsageError` if it is missing or can give no rate."""
    law = _of_stages(found) if by == "stages" else _of_joint(found)
    if law.K0_v_per_dps == 0.0 or (law.name == "sine" and law.S_rad_per_dps == 0.0):
        raise UsageError(
            "the scale factor, or S of the sine, is 0, which gives no rate for an output; write it with `benchctl fit`"
        )
    if found.T0_c is None and law.knows_temperature:
        raise UsageError("T0_c is null, though the law depends on the temperature; write it with `benchctl fit`")
    extra = found.discovered
    return law if extra is None else replace(law, discovered=discovered_in(extra.U0_v, extra.structures))


def is_of_law(name: str, law: AppliedLaw) -> bool:
    """Return whether a parameter of the file belongs to the law: not an encoder error, and S only for a sine."""
    own = ("K0_v_per_dps", "U0_v", "delay_s", *(("S_rad_per_dps",) if law.name == "sine" else ()))
    return name in own or _TERM.fullmatch(name) is not None


def _of_joint(found: Coefficients) -> AppliedLaw:
    joint = found.joint
    if joint is None:
        raise UsageError("these coefficients hold no joint fit; compensate by their stages")
    values = {name: parameter.value for name, parameter in joint.parameters.items()}
    for name in ("K0_v_per_dps", "U0_v", *(("S_rad_per_dps",) if joint.law == "sine" else ())):
        if name not in values:
            raise UsageError(f"the joint fit, law {joint.law}, has no {name}; write it with `benchctl fit`")
    return applied_of(values, joint.law, found.T0_c or 0.0)


def applied_of(values: Mapping[str, float], law: LawName, T0_c: float) -> AppliedLaw:
    """Return a law of a joint fit with the values of the fit's parameters by name."""
    sine = law == "sine"
    return AppliedLaw(
        name=law,
        K0_v_per_dps=values["K0_v_per_dps"],
        U0_v=values["U0_v"],
        T0_c=T0_c,
        bias=_terms(values, "c", 1),
        S_rad_per_dps=values["S_rad_per_dps"] if sine else 0.0,
        stages=(Factors(k_t=_terms(values, "g" if sine else "a", 1), k_omega=() if sine else _terms(values, "b", 2)),),
        delay_s=values.get("delay_s", 0.0),
    )


def _of_stages(found: Coefficients) -> AppliedLaw:
    """Return the law of the stages; K0, U0 and the bias are those of the last one."""
    response = found.convention == "response"
    if response and len(found.stages) != 1:
        raise UsageError(
            f"a response of {len(found.stages)} stages has no one inverse, expected one stage; "
            "write it with `benchctl fit`"
        )
    last = found.stages[-1]
    return AppliedLaw(
        name="response" if response else "polynomial",
        K0_v_per_dps=found.K0_v_per_dps,
        U0_v=found.U0_v,
        T0_c=found.T0_c or 0.0,
        bias=tuple(last.U0_T),
        stages=tuple(
            Factors(k_t=tuple(stage.k_t.coefficients), k_omega=tuple(stage.k_omega.coefficients))
            for stage in found.stages
        ),
        delay_s=last.delay_s,
    )


def _terms(values: Mapping[str, float], letter: str, power: int) -> tuple[float, ...]:
    """Return the coefficients of a polynomial in the power `power`: `a1`, `a2`, … for 1, `b2`, `b4`, … for 2."""
    found = {int(term[2]): values[name] for name in values if (term := _TERM.fullmatch(name)) and term[1] == letter}
    if any(order == 0 or order % power or order // power > _MOST_TERMS for order in found):
        raise UsageError(
            f"the joint fit has the terms {listed([f'{letter}{order}' for order in found])}, which are no "
            "polynomial's; write it with `benchctl fit`"
        )
    orders = range(power, max(found, default=0) + 1, power)
    return tuple(found.get(order, 0.0) for order in orders)


SCHEMA = "benchctl-coefficients/1"
THREE_AXES_SCHEMA = "benchctl-three-axes/1"
"""Of a unit of three axes: `calibration.three_axes` writes it; of the keys above only `uncertainty`, `valid`, `source`
and `T0_c` are the same."""
_KEYS = ("convention", "argument", "K0_v_per_dps", "U0_v", "T0_c", "stages")


def coefficients(result: CalibrationResult, source: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Return the content of `coefficients.json`; `source` is the name and the digest of each recording."""
    last, best = result.stages[-1], result.best
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "unit": result.unit,
        "output_unit": result.output_unit,
        "convention": "correction",
        "argument": "indicated",
        "K0_v_per_dps": last.K0_v_per_dps,
        "U0_v": last.U0_v,
        "T0_c": result.T0_c,
        "stages": [_stage(stage) for stage in result.stages],
        "valid": {"rate_dps": list(result.valid.rate_dps), "temperature_c": list(result.valid.temperature_c)},
        "uncertainty": {
            "k": 2,
            "level": LEVEL,
            "of": f"joint fit, law {best.law}",
            "parameters": {parameter.name: _uncertainty(parameter) for parameter in best.parameters},
        },
        "source": [{"recording": name, "digest": digest} for name, digest in source],
        "error_percent": dict(result.error_percent),
        "rms_percent": dict(result.rms_percent),
        "joint": _joint(best),
        "free_motion": None if result.free_motion is None else _free_motion(result.free_motion),
        "joint_others": [_joint(fit) for fit in result.joint[1:]],
        "earth_rate_dps": result.earth_rate_dps,
        "rates_are": "sensed: the table's rate plus `earth_rate_dps`",
        "warnings": list(result.warnings),
        "notes": list(result.notes),
    }
    if result.discovered:
        content["discovered"] = result.discovered.as_json()
    finite: dict[str, Any] = json_values(content)
    return finite


def write_coefficients(path: Path, content: Mapping[str, Any]) -> None:
    """Write the file atomically; raise `UsageError` if the disk cannot be written."""
    with whole_file(path) as temporary:
        temporary.write_text(
            json.dumps(content, ensure_ascii=False, indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )


def read_coefficients(path: Path) -> dict[str, Any]:
    """Read a file of coefficients, and check that of one axis; raise `UsageError` in one line if it cannot be used."""
    content = read_json(path, "coefficients")
    if is_of_three_axes(content):
        return dict(content)
    return coefficients_in(content, path)


def is_of_three_axes(content: Any) -> bool:
    """Return whether the content of a file of coefficients is that of a unit of three axes."""
    return isinstance(content, dict) and content.get("schema") == THREE_AXES_SCHEMA


def coefficients_in(content: Any, path: Path) -> dict[str, Any]:
    """Check and return the content of a file of coefficients; `path` is its name in a `UsageError`."""
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else type(content).__name__
        raise UsageError(f"{path}: expected schema {SCHEMA!r}, found {found!r}; write it with `benchctl fit`")
    for key in _KEYS:
        if key not in content:
            raise UsageError(f"{path}: the key {key!r} is missing; write it with `benchctl fit`")
    convention, argument = content["convention"], content["argument"]
    if convention not in ("correction", "response") or argument not in ("indicated", "true"):
        raise UsageError(
            f"{path}: convention {convention!r} with argument {argument!r} is not known; expected 'correction' or "
            "'response', 'indicated' or 'true'"
        )
    if (convention, argument) not in (("correction", "indicated"), ("response", "true")):
        raise UsageError(
            f"{path}: a {convention} of the {argument} rate cannot be applied: in operation a correction knows only "
            "the indicated rate, and a response is a function of the true one; write it with `benchctl fit`"
        )
    if not content["stages"]:
        raise UsageError(f"{path}: `stages` is empty, expected at least one; write it with `benchctl fit`")
    return content


def compensate(
    u_v: FloatArray,
    temp_c: FloatArray,
    content: Mapping[str, Any],
    *,
    by: By = "stages",
    earth_rate: Literal["keep", "remove"] = "keep",
) -> FloatArray:
    """Return the sensed rate [°/s] for outputs [V] at gyro temperatures [°C], arrays of one shape (n,).

    By the stages, or by the joint fit if the content has one. No delay is applied: the rate applies to the output's
    time stamp minus `delay_s`. NaN if the law has no rate for an output. `earth_rate="remove"` gives the table's rate.
    """
    law = applied_law(checked(content, "these coefficients"), by)
    rate = law.rate_dps(np.asarray(u_v, dtype=np.float64), np.asarray(temp_c, dtype=np.float64))
    return rate - float(content.get("earth_rate_dps", 0.0)) if earth_rate == "remove" else rate


def _factor(polynomial: PolynomialFactor) -> dict[str, Any]:
    return {
        "coefficients": list(polynomial.coefficients),
        "covariance": [list(row) for row in polynomial.covariance],
        "basis": list(polynomial.basis),
        "dof": polynomial.dof,
    }


def _stage(stage: Stage) -> dict[str, Any]:
    return {
        "name": stage.name,
        "k_T": _factor(stage.k_t),
        "k_omega": _factor(stage.k_omega),
        "K0_v_per_dps": stage.K0_v_per_dps,
        "U0_v": stage.U0_v,
        "U0_T": list(stage.u0_t),
        "delay_s": stage.delay_s,
        "error_percent": {"before": stage.error_percent.before, "after": stage.error_percent.after},
        "rms_percent": {"before": stage.rms_percent.before, "after": stage.rms_percent.after},
        "standard": dict(stage.standard),
        "dof": dict(stage.dof),
        "shares": {share.part: share.share for share in stage.shares},
    }


def _joint(fit: JointFit) -> dict[str, Any]:
    return {
        "law": fit.law,
        "convention": fit.convention,
        "argument": fit.argument,
        "parameters": {
            p.name: {"value": p.value, "unit": p.unit, "standard": p.standard, "ci95": list(p.ci95), "says": p.says}
            for p in fit.parameters
        },
        "covariance": {"order": [p.name for p in fit.parameters], "matrix": fit.covariance.tolist()},
        "noise": {
            "white_v": fit.noise.white_v,
            "random_walk_v_per_sqrt_s": fit.noise.random_walk_v_per_sqrt_s,
            "mean_excess": fit.noise.mean_excess,
        },
        "bic": fit.bic,
    }


def _free_motion(fit: FreeMotionFit) -> dict[str, Any]:
    return {
        "scale_v_per_dps": {"value": fit.scale, "ci95": list(fit.scale_ci95)},
        "delay_s": {"value": fit.delay_s, "ci95": list(fit.delay_ci95)},
        "angle_residual_deg": {"before": fit.before_deg, "after": fit.after_deg},
        "band_hz": list(fit.band_hz),
    }


def _uncertainty(parameter: FittedParameter) -> dict[str, Any]:
    return {
        "value": parameter.value,
        "unit": parameter.unit,
        "ci95": list(parameter.ci95),
        "expanded": parameter.expanded,
        "k": parameter.k,
        "dof": parameter.dof,
        "budget": [
            {"source": part.source, "kind": part.kind, "standard": part.standard, "dof": part.dof, "says": part.says}
            for part in parameter.budget
        ],
    }


def points_coefficients(
    result: StaticPointsResult, *, unit: str, temperature_c: float | None, source: Sequence[tuple[str, str]]
) -> dict[str, Any]:
    """Return the content of `coefficients.json`: U = U0 + K0·k(ω)·ω, k(ω) the series of sin(Sω)/(Sω) to ω⁴.

    The convention is `response`, its argument the true rate. No run is held out, so there is no `error_percent`.
    `temperature_c` is None if it was not recorded.
    """
    fit = result.rotating
    S = fit.S_rad_per_dps
    slopes = (-S / 3.0, S**3 / 30.0)  # of the two coefficients with respect to S
    variance = (fit.expanded(fit.S_ci95) / coverage_factor(fit.dof)) ** 2
    nothing: dict[str, Any] = {"coefficients": [], "covariance": []}
    return {
        "schema": SCHEMA,
        "unit": unit,
        "output_unit": "V",
        "convention": "response",
        "argument": "true",
        "K0_v_per_dps": fit.K0_v_per_dps,
        "U0_v": fit.U0_v,
        "T0_c": temperature_c,
        "stages": [
            {
                "name": "static points",
                "k_T": nothing,
                "k_omega": {
                    "coefficients": [-(S**2) / 6.0, S**4 / 120.0],
                    "covariance": [[variance * a * b for b in slopes] for a in slopes],
                },
                "K0_v_per_dps": fit.K0_v_per_dps,
                "U0_v": fit.U0_v,
                "delay_s": 0.0,
                "error_percent": {"before": None, "after": None},
            }
        ],
        "valid": {
            "rate_dps": [-fit.full_scale_dps, fit.full_scale_dps],
            "temperature_c": [temperature_c, temperature_c],
        },
        "uncertainty": {
            "k": 2,
            "level": LEVEL,
            "of": "sine law through the rotating points",
            "parameters": {
                "K0_v_per_dps": _points_uncertainty(fit, fit.K0_v_per_dps, fit.K0_ci95, "V/(°/s)"),
                "U0_v": _points_uncertainty(fit, fit.U0_v, fit.U0_ci95, "V"),
                "S_rad_per_dps": _points_uncertainty(fit, S, fit.S_ci95, "rad/(°/s)"),
            },
        },
        "source": [{"recording": name, "digest": digest} for name, digest in source],
        "error_percent": {},
        "rms_percent": {},
        "misfit_percent_of_full_scale": {
            "line": fit.line.rms_percent_fs,
            "sine": fit.sine.rms_percent_fs,
            "line_largest": fit.line.largest_percent_fs,
            "sine_largest": fit.sine.largest_percent_fs,
        },
        "warnings": ["No run was kept aside: the misfit is that of the fitted points themselves."],
        "notes": [result.says],
    }


def _points_uncertainty(fit: PointsFit, value: float, ci95: tuple[float, float], unit: str) -> dict[str, Any]:
    return {
        "value": value,
        "unit": unit,
        "ci95": list(ci95),
        "expanded": fit.expanded(ci95),
        "k": coverage_factor(fit.dof),
        "dof": fit.dof,
    }
