"""The gyro's laws: output against rate, k(ω), and k(T) with the bias over temperature."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchctl.calibration.laws_fit import law_of
from benchctl.calibration.model import Law
from benchctl.calibration.result import CalibrationResult, JointFit
from benchctl.reports.figures import GREY, INK, LEVEL_COLOURS, new_figure
from benchctl.reports.law_curves import (
    Z95,
    Curve,
    at_reference,
    bias,
    factor_curve,
    indicated,
    joint_curve,
    zero_reading,
)
from benchctl_instruments.arrays import FloatArray

LAW_NAMES = {"sine": "sine law", "polynomial": "polynomial", "response": "response polynomial"}

_CURVE_POINTS = 160
_LEAST_RATE_SHARE = 0.05
"""Below this share of the largest rate a ratio of rates is mostly noise."""


def output_figure(result: CalibrationResult) -> Figure | None:
    """Output against rate at T0, and its distance from the straight line; None without rates at T0."""
    points, here = result.points, at_reference(result)
    if np.unique(points.rate_dps[here]).size < 3:
        return None
    rate, output, line = points.rate_dps[here], points.output_v[here], result.raw
    grid = np.linspace(rate.min(), rate.max(), _CURVE_POINTS)
    straight = line.U0_v + line.K0_v_per_dps * grid
    figure = new_figure(2.5)
    left, right = figure.subplots(1, 2)
    left.plot(grid, straight, color=LEVEL_COLOURS["raw"], linestyle="--", label="straight line (raw)")
    if result.joint:
        law = _volts(result.best, grid, np.zeros_like(grid))
        name = LAW_NAMES.get(result.best.law, result.best.law)
        left.plot(grid, law, color=LEVEL_COLOURS["joint"], label=f"{name} (joint fit)")
        right.plot(grid, (law - straight) / line.K0_v_per_dps, color=LEVEL_COLOURS["joint"])
    _points(left, rate, output, label=f"means at {result.T0_c:.3g} °C")
    _points(right, rate, (output - line.U0_v) / line.K0_v_per_dps - rate)
    right.axhline(0.0, color=LEVEL_COLOURS["raw"], linestyle="--")
    left.set(xlabel="rate (°/s)", ylabel=f"output ({result.output_unit})")
    left.set_title("output")
    right.set(xlabel="rate (°/s)", ylabel="distance from the straight line (°/s)")
    right.set_title("what the straight line misses")
    left.legend(loc="upper left" if line.K0_v_per_dps > 0 else "upper right")
    return figure


def k_omega_figure(result: CalibrationResult) -> Figure | None:
    """k(ω) at T0 with points and 95 % bands, and the same less the last fit's curve; None without enough points."""
    if not result.stages or not result.stages[0].k_omega.coefficients:
        return None
    stage, points, here = result.stages[0], result.points, at_reference(result)
    signed = indicated(points, stage.K0_v_per_dps, zero_reading(result, stage))
    used = here & (np.abs(signed) > _LEAST_RATE_SHARE * np.abs(signed[here]).max(initial=0.0))
    if used.sum() < 3:
        return None
    x, measured = np.abs(signed[used]), 100 * (points.rate_dps[used] / signed[used] - 1)
    error = 100 * Z95 * points.output_se_v[used] / abs(stage.K0_v_per_dps) / x
    grid = np.linspace(x.min(), x.max(), _CURVE_POINTS)
    curves = {"stage_1": _in_percent(factor_curve(stage.k_omega, grid**2))}
    joint = next((fit for fit in result.joint if fit.law == "sine"), result.joint[0] if result.joint else None)
    if joint is not None:
        curves["joint"] = _in_percent(_joint_k_omega(joint, grid, stage.K0_v_per_dps))
    figure = new_figure(2.5)
    left, right = figure.subplots(1, 2)
    labels = {
        "stage_1": "stage 1 (polynomial)",
        "joint": f"joint fit ({LAW_NAMES.get(joint.law, '')})" if joint else "",
    }
    reference = curves.get("joint", curves["stage_1"]).value
    for level, curve in curves.items():
        _band(left, grid, curve, level, label=labels[level])
        _band(right, grid, Curve(value=curve.value - reference, half=curve.half), level)
    for axes, y in ((left, measured), (right, measured - np.interp(x, grid, reference))):
        axes.errorbar(x, y, yerr=error, **_POINTS, label="measured, 95 % interval")
        axes.set_xlabel("|indicated rate| (°/s)")
    left.set_ylabel("k(ω) − 1 (%)")
    left.set_title("k(ω): what the indicated rate is multiplied by")
    right.set_ylabel("difference (%)")
    right.set_title(f"less the curve of {'the joint fit' if joint else 'stage 1'}")
    left.legend(loc="upper left" if measured[-1] > measured[0] else "lower left")
    return figure


def k_temperature_figure(result: CalibrationResult) -> Figure | None:
    """k(T) and the bias over temperature, with points and 95 % bands; None where there is one temperature only."""
    found = result.temperatures
    if len(found) < 2 or not result.stages:
        return None
    stage = result.stages[0]
    temperature = np.array([point.temperature_c for point in found])
    slope = np.array([point.slope_v_per_dps for point in found])
    relative = np.array([point.slope_standard for point in found]) / np.abs(slope)
    grid = np.linspace(temperature.min(), temperature.max(), _CURVE_POINTS)
    curve = factor_curve(stage.k_t, grid - result.T0_c)
    # The points share the curve's normalisation: only their shape over temperature is k(T).
    common = float(np.median(slope * np.interp(temperature, grid, curve.value)))
    figure = new_figure(2.4)
    left, right = figure.subplots(1, 2)
    _band(left, grid, _in_percent(curve), "stage_1", label="stage 1 (polynomial)")
    stage_bias = stage.U0_v + sum(c * (grid - result.T0_c) ** (i + 1) for i, c in enumerate(stage.u0_t))
    if stage.u0_t:
        right.plot(grid, 1e3 * stage_bias, color=LEVEL_COLOURS["stage_1"])
    if result.joint:
        warm = joint_curve(result.best, lambda law, p: _joint_k_t(law, p, grid - result.T0_c))
        _band(left, grid, _in_percent(warm), "joint", label="joint fit", linestyle="--")
        right.plot(grid, 1e3 * bias(result.best, grid - result.T0_c), color=LEVEL_COLOURS["joint"], linestyle="--")
    left.errorbar(
        temperature, 100 * (common / slope - 1), yerr=100 * Z95 * relative, **_POINTS, label="measured, 95 % interval"
    )
    bias_half = Z95 * np.array([point.bias_standard for point in found])
    right.errorbar(temperature, [1e3 * point.bias_v for point in found], yerr=1e3 * bias_half, **_POINTS)
    left.set(xlabel="temperature (°C)", ylabel="k(T) − 1 (%)")
    left.set_title("k(T): scale factor over temperature")
    right.set(xlabel="temperature (°C)", ylabel=f"output at rest (10⁻³ {result.output_unit})")
    right.set_title("bias over temperature")
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


_POINTS: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 2.8,
    "linewidth": 0.8,
    "color": INK,
    "ecolor": GREY,
    "zorder": 3,
}


def _volts(joint: JointFit, rate_dps: FloatArray, dt_c: FloatArray) -> FloatArray:
    law, parameters, *_ = law_of(joint)
    return np.asarray(bias(joint, dt_c) + law.volts(parameters, rate_dps, dt_c))


def _joint_k_omega(joint: JointFit, x: FloatArray, K0: float) -> Curve:
    """True rate by the joint fit over the rate that K0 indicates, at T0, the bias taken off."""
    return joint_curve(joint, lambda law, parameters: law.rate(parameters, K0 * x, np.zeros_like(x)) / x)


def _joint_k_t(law: Law, parameters: FloatArray, dt_c: FloatArray) -> FloatArray:
    """The correction for temperature that a law stands for: 1 at T0, the reverse of a response."""
    warm = parameters[1 + law.rate_terms :]
    powers = 1 + sum((c * dt_c ** (i + 1) for i, c in enumerate(warm)), np.zeros_like(dt_c))
    return np.asarray(powers if law.convention == "correction" else 1 / powers)


def _points(axes: Axes, x: FloatArray, y: FloatArray, label: str | None = None) -> None:
    axes.plot(x, y, linestyle="none", marker="o", markersize=2.8, color=INK, label=label, zorder=3)


def _band(
    axes: Axes, x: FloatArray, curve: Curve, level: str, *, label: str | None = None, linestyle: str = "-"
) -> None:
    axes.fill_between(
        x, curve.value - curve.half, curve.value + curve.half, color=LEVEL_COLOURS[level], alpha=0.25, lw=0
    )
    axes.plot(x, curve.value, color=LEVEL_COLOURS[level], linestyle=linestyle, label=label)


def _in_percent(curve: Curve) -> Curve:
    return Curve(value=100 * (curve.value - 1), half=100 * curve.half)
