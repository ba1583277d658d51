"""Figures of the gyro's laws k(ω), k(T) and the bias over temperature, with confidence bands, and of the residuals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchctl.calibration.laws_fit import law_of
from benchctl.calibration.model import Law
from benchctl.calibration.result import CalibrationResult, JointFit, MeanPoints, PolynomialFactor, Stage
from benchctl.calibration.uncertainty import coverage_factor
from benchctl.reports.figures import FAINT, GREY, INK, LEVEL_COLOURS, dots, level_names, new_figure
from benchctl.reports.reduction import binned, spread, thinned
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.response_gyro import one_plus

_NEAR_T0_C = 1.5
_AT_REST_DPS = 0.05  # less than the Earth's rate


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveWithBand:
    """A function and the half-width of its 95 % band, both of shape (n,)."""

    value: FloatArray
    half: FloatArray


def factor_curve(of: PolynomialFactor, argument: FloatArray) -> CurveWithBand:
    """Return a factor k against ΔT, or against ω² if its powers are even; argument of shape (n,)."""
    powers = np.stack([argument ** (i + 1) for i in range(len(of.coefficients))], axis=-1)
    covariance = np.array(of.covariance, dtype=np.float64).reshape(len(of.coefficients), -1)
    variance = np.einsum("ni,ij,nj->n", powers, covariance, powers)
    half = coverage_factor(of.dof, 0.95) * np.sqrt(np.maximum(variance, 0.0))
    return CurveWithBand(value=one_plus(of.coefficients, argument), half=half)


def bias(joint: JointFit, dt_c: FloatArray) -> FloatArray:
    """Return the output at rest by a joint fit; shape as ΔT."""
    _, _, offset, terms = law_of(joint)
    return offset + one_plus(terms, dt_c) - 1.0


def joint_curve(joint: JointFit, function: Callable[[Law, FloatArray], FloatArray]) -> CurveWithBand:
    """Return a function of a law and its parameters with its confidence band from the parameters' covariance."""
    law, best, *_ = law_of(joint)
    order = [[parameter.name for parameter in joint.parameters].index(name) for name in law.names]
    covariance = np.asarray(joint.covariance)[np.ix_(order, order)]
    steps = np.sqrt(np.diag(covariance))
    value = function(law, best)
    slopes = np.zeros((value.size, best.size))
    for i, step in enumerate(steps):
        if step > 0:
            shift = np.zeros(best.size)
            shift[i] = step
            slopes[:, i] = (function(law, best + shift) - function(law, best - shift)) / (2 * step)
    variance = np.einsum("ni,ij,nj->n", slopes, covariance, slopes)
    return CurveWithBand(value=value, half=Z95 * np.sqrt(np.maximum(variance, 0.0)))


def at_reference(result: CalibrationResult) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of the mean points measured at T0 ± 1.5 °C."""
    return np.asarray(np.abs(result.points.temperature_c - result.T0_c) <= _NEAR_T0_C)


def zero_reading(result: CalibrationResult, stage: Stage) -> float:
    """Return the bias during the measurement of k(ω): from the readings at rest at T0, else U0 of the stage."""
    points = result.points
    rest = at_reference(result) & (np.abs(points.rate_dps) < _AT_REST_DPS)
    if not rest.any():
        return stage.U0_v
    return float(np.mean(points.output_v[rest] - stage.K0_v_per_dps * points.rate_dps[rest]))


def indicated(points: MeanPoints, K0: float, U0: float) -> FloatArray:
    """Return the rate in °/s that a straight line gives for the means; shape (n,)."""
    return np.asarray((points.output_v - U0) / K0)


LAW_NAMES = {"sine": "sine law", "polynomial": "polynomial", "response": "response polynomial"}

_CURVE_POINTS = 160
_LEAST_RATE_SHARE = 0.05
"""Below this share of the largest rate a ratio of rates is mostly noise."""


def output_figure(result: CalibrationResult) -> Figure | None:
    """Plot output against rate at T0, and its deviation from the straight line; None without rates at T0."""
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
    """Plot k(ω) at T0 with points and 95 % bands, and its deviation from the last fit; None with too few points."""
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
        _band(right, grid, CurveWithBand(value=curve.value - reference, half=curve.half), level)
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
    """Plot k(T) and the bias over temperature, with points and 95 % bands; None for a single temperature."""
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


def _joint_k_omega(joint: JointFit, x: FloatArray, K0: float) -> CurveWithBand:
    """Return the true rate by the joint fit divided by the rate that K0 indicates, at T0, with the bias subtracted."""
    return joint_curve(joint, lambda law, parameters: law.rate(parameters, K0 * x, np.zeros_like(x)) / x)


def _joint_k_t(law: Law, parameters: FloatArray, dt_c: FloatArray) -> FloatArray:
    """Return the temperature correction of a law: 1 at T0, the reciprocal for a response."""
    warm = parameters[1 + law.rate_terms :]
    powers = 1 + sum((c * dt_c ** (i + 1) for i, c in enumerate(warm)), np.zeros_like(dt_c))
    return np.asarray(powers if law.convention == "correction" else 1 / powers)


def _points(axes: Axes, x: FloatArray, y: FloatArray, label: str | None = None) -> None:
    axes.plot(x, y, linestyle="none", marker="o", markersize=2.8, color=INK, label=label, zorder=3)


def _band(
    axes: Axes, x: FloatArray, curve: CurveWithBand, level: str, *, label: str | None = None, linestyle: str = "-"
) -> None:
    axes.fill_between(
        x, curve.value - curve.half, curve.value + curve.half, color=LEVEL_COLOURS[level], alpha=0.25, lw=0
    )
    axes.plot(x, curve.value, color=LEVEL_COLOURS[level], linestyle=linestyle, label=label)


def _in_percent(curve: CurveWithBand) -> CurveWithBand:
    return CurveWithBand(value=100 * (curve.value - 1), half=100 * curve.half)


_BINS = 24
_FEWEST_FOR_A_HISTOGRAM = 50


def last_level(result: CalibrationResult) -> str | None:
    """Return the last level for which there are residuals."""
    reached = level_names(tuple(result.residuals.residual_dps))
    return reached[-1] if reached else None


def final_residuals_figure(result: CalibrationResult, level: str) -> Figure:
    """Plot residuals of one level in 0.001 °/s, binned means against rate and acceleration, and the distribution.

    Shows the held-out runs, or all runs if none was held out.
    """
    left = result.residuals
    shown = left.verify if left.verify.any() else np.ones_like(left.verify)
    residual = 1e3 * left.residual_dps[level][shown]
    coordinates = {"rate (°/s)": left.rate_dps[shown], "acceleration (°/s²)": left.acceleration_dps2[shown]}
    coordinates = {label: x for label, x in coordinates.items() if spread(x) > 0}
    histogram = np.isfinite(residual).sum() >= _FEWEST_FOR_A_HISTOGRAM
    figure = new_figure(2.3)
    panels = figure.subplots(1, len(coordinates) + int(histogram), sharey=True, squeeze=False)[0]
    for axes, (label, x) in zip(panels, coordinates.items(), strict=False):
        _with_means(axes, x, residual, LEVEL_COLOURS[level])
        axes.set_xlabel(label)
    panels[0].set_ylabel("residual (0.001 °/s)")
    if histogram:
        _histogram(panels[-1], residual[np.isfinite(residual)], LEVEL_COLOURS[level])
    block = Line2D([], [], linestyle="none", marker=".", color=FAINT, label="block of a run")
    figure.legend(handles=[block, *_named(panels)], loc="outside upper center", ncols=3)
    return figure


def _with_means(axes: Axes, x: FloatArray, residual: FloatArray, colour: str) -> None:
    points = thinned(x, residual)
    dots(axes, x[points], residual[points], FAINT)
    bins = binned(x, residual, _BINS)
    axes.errorbar(
        bins.centre,
        bins.mean,
        yerr=Z95 * np.nan_to_num(bins.mean_se),
        linestyle="none",
        marker="o",
        markersize=2.5,
        linewidth=0.9,
        color=colour,
        label="mean in a bin, 95 % interval",
    )
    axes.axhline(0.0, color=INK, linewidth=0.5)


def _histogram(axes: Axes, residual: FloatArray, colour: str) -> None:
    axes.hist(residual, bins=40, orientation="horizontal", color=colour, alpha=0.55, density=True)
    spread, middle = float(residual.std()), float(residual.mean())
    if spread > 0:
        y = np.linspace(*axes.get_ylim(), 200)
        normal = np.exp(-0.5 * ((y - middle) / spread) ** 2) / (spread * np.sqrt(2 * np.pi))
        axes.plot(normal, y, color=GREY, linestyle="--", label="normal distribution of the same spread")
    axes.set_xlabel("share per 0.001 °/s")
    axes.locator_params(axis="x", nbins=4)


def _named(panels: Sequence[Axes]) -> list[Artist]:
    """Return the artists that have a label, each label once."""
    found: dict[str, Artist] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values())
