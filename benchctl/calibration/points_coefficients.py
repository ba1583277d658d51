"""`coefficients.json` from a table of static points: one temperature, so one response stage by the sine law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchctl.calibration.coefficients import SCHEMA
from benchctl.calibration.static_points_fit import PointsFit, StaticPointsResult
from benchctl.calibration.uncertainty import LEVEL, coverage_factor


def points_coefficients(
    result: StaticPointsResult, *, unit: str, temperature_c: float | None, source: Sequence[tuple[str, str]]
) -> dict[str, Any]:
    """The content of `coefficients.json`: U = U0 + K0·k(ω)·ω, with k(ω) the series of sin(Sω)/(Sω) to ω⁴.

    The convention is `response`, its argument the true rate. No run was kept aside, so there is no `error_percent`.
    `temperature_c` is None where it is not recorded.
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
                "K0_v_per_dps": _uncertainty(fit, fit.K0_v_per_dps, fit.K0_ci95, "V/(°/s)"),
                "U0_v": _uncertainty(fit, fit.U0_v, fit.U0_ci95, "V"),
                "S_rad_per_dps": _uncertainty(fit, S, fit.S_ci95, "rad/(°/s)"),
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


def _uncertainty(fit: PointsFit, value: float, ci95: tuple[float, float], unit: str) -> dict[str, Any]:
    return {
        "value": value,
        "unit": unit,
        "ci95": list(ci95),
        "expanded": fit.expanded(ci95),
        "k": coverage_factor(fit.dof),
        "dof": fit.dof,
    }
