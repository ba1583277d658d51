"""`coefficients.json`: writing it to the letter of its specification, reading it back, and compensating with it.

| key | what |
|---|---|
| `schema` | `benchctl-coefficients/1` |
| `convention`, `argument` | of the stages: `correction` of the `indicated` rate (a foreign file may say otherwise) |
| `K0_v_per_dps`, `U0_v`, `T0_c` | those of the last stage |
| `stages` | list: `k_T`, `k_omega` (`coefficients`, `covariance`), `K0_v_per_dps`, `U0_v`, `U0_T`, `delay_s`, … |
| `valid` | ranges `rate_dps` and `temperature_c` that were measured |
| `uncertainty` | at the level of k = 2, 95.45 %: by parameter of the joint fit `expanded`, the factor `k` that its |
|               | degrees of freedom `dof` (null: infinite) demand, and its budget by contributor |
| `source` | digests of the recordings |
| `error_percent`, `rms_percent` | per level, on runs that were not fitted |
| `joint` | the joint fit: law, convention, argument, parameters, covariance |

k_T is 1 + Σ c_i·(T − T0)^i, k_omega 1 + Σ c_i·x^(2i), x the input of its stage.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchctl.atomic import whole_file
from benchctl.calibration.coefficients_law import By, applied_law, checked
from benchctl.calibration.free_motion import FreeMotionFit
from benchctl.calibration.result import CalibrationResult, JointFit, Parameter, PolynomialFactor, Stage
from benchctl.calibration.uncertainty import LEVEL
from benchctl.documents import read_json
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

SCHEMA = "benchctl-coefficients/1"
_KEYS = ("convention", "argument", "K0_v_per_dps", "U0_v", "T0_c", "stages")


def coefficients(result: CalibrationResult, source: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """The content of `coefficients.json`; `source` is the name and the digest of each recording."""
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
    finite: dict[str, Any] = _finite(content)
    return finite


def write_coefficients(path: Path, content: Mapping[str, Any]) -> None:
    """Write the file atomically; `UsageError` where the disk refuses."""
    with whole_file(path) as temporary:
        temporary.write_text(
            json.dumps(content, ensure_ascii=False, indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )


def read_coefficients(path: Path) -> dict[str, Any]:
    """Read and check a file of coefficients; `UsageError` in one line where it cannot be used."""
    return coefficients_in(read_json(path, "coefficients"), path)


def coefficients_in(content: Any, path: Path) -> dict[str, Any]:
    """The content of a file of coefficients, `path` its name in the `UsageError` where it cannot be used."""
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
            f"{path}: a {convention} of the {argument} rate cannot be applied: in operation a "
            "correction knows only the indicated rate, and a response is a function of the true one; write it with "
            "`benchctl fit`"
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
    """Sensed rate [°/s] of outputs [V] at gyro temperatures [°C], arrays of one shape (n,).

    By the stages, or by the joint fit where the content holds one. No delay is applied: the rate is at the output's
    stamp less `delay_s`. NaN where the law has no rate for an output. `earth_rate="remove"` gives the table's rate.
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


def _uncertainty(parameter: Parameter) -> dict[str, Any]:
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


def _finite(value: Any) -> Any:
    """JSON has no NaN: what is not known is null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
