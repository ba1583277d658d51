"""The report on a table of static points: fits of a straight line and a sine, and the points at rest."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from benchctl.calibration.static_points_fit import PointsFit, StaticPointsResult
from benchctl.recordings.model import Meta
from benchctl.recordings.static_points import StaticPoints
from benchctl.reports import setup_section, text, verdict
from benchctl.reports.coefficient_tables import Coefficient
from benchctl.reports.figures import INK, LEVEL_COLOURS, LEVEL_MARKERS, Drawing, inline_svg, new_figure, style
from benchctl.reports.html import render


def static_points_page(result: StaticPointsResult, points: StaticPoints, meta: Meta, *, digest: str) -> str:
    """Return the page as text. The same input gives the same bytes."""
    output_unit = text.unit_text(meta.output_unit)
    return render(
        "points.html.j2",
        meta=meta,
        status=verdict.status_text(meta),
        result=result,
        fit=result.rotating,
        verdict=_sentence(result),
        setup=_facts(points, meta),
        drawing=_drawing(result, points, output_unit),
        coefficients=coefficients(result.rotating, output_unit),
        fits=_fits(result),
        output_unit=output_unit,
        scale_unit=text.scale_unit(output_unit),
        spreads=_spreads(result, output_unit),
        provenance_rows=setup_section.provenance(meta, digest),
    )


def _sentence(result: StaticPointsResult) -> str:
    fit = result.rotating
    return (
        f"Over ±{text.plain(fit.full_scale_dps, '°/s')} a straight line misses the {fit.points} rotating points by "
        f"{text.percent(fit.line.rms_percent_fs)} of full scale (rms), the sine of an open-loop interferometer by "
        f"{text.percent(fit.sine.rms_percent_fs)}."
    )


def _facts(points: StaticPoints, meta: Meta) -> list[tuple[str, str]]:
    rows = [("Points", text.count(points.rate_dps.size))]
    if points.run is not None:
        rows.append(("Runs", text.count(len(set(points.run.tolist())))))
    if points.temperature_c is not None:
        ends = float(points.temperature_c.min()), float(points.temperature_c.max())
        rows.append(("Temperature", text.span(*ends, "°C")))
    if points.duration_s is not None:
        rows.append(("Each mean over", text.span(float(points.duration_s.min()), float(points.duration_s.max()), "s")))
    left_out = ("Samples", "Duration", "Sample rate")  # a table of means has none
    return [(name, value) for name, value in setup_section.facts(meta, []) if name not in left_out] + rows


def _drawing(result: StaticPointsResult, points: StaticPoints, output_unit: str) -> Drawing:
    with style():
        svg = inline_svg(points_figure(result, points, output_unit), "points")
    return Drawing(
        svg=svg,
        alt=f"Output against rate, and what a straight line and a sine leave of it. {_sentence(result)}",
        caption="Left: means of the output against commanded rate, with both laws through the rotating points. "
        "Right: the rate that each law reads from the means, less the commanded one.",
    )


def coefficients(fit: PointsFit, output_unit: str) -> list[Coefficient]:
    """Return the parameters of the sine law with their expanded uncertainties."""
    return [
        _row(fit, "K0", fit.K0_v_per_dps, fit.K0_ci95, text.scale_unit(output_unit), "scale factor at low rates"),
        _row(fit, "U0", fit.U0_v, fit.U0_ci95, output_unit, "output at rest, by the rotating points"),
        _row(fit, "S", fit.S_rad_per_dps, fit.S_ci95, "rad/(°/s)", "interferometer's phase per rate: sine's argument"),
    ]


def _row(fit: PointsFit, symbol: str, value: float, ends: tuple[float, float], unit: str, says: str) -> Coefficient:
    stated = text.with_uncertainty(value, fit.expanded(ends), unit)
    return Coefficient(name=symbol, symbol=symbol, value=value, stated=stated, interval=text.interval(*ends), says=says)


def _fits(result: StaticPointsResult) -> list[dict[str, object]]:
    lines = [{"points": "rotating points", "count": result.rotating.points, "fit": result.rotating}]
    if result.rest_points:
        lines.append({"points": "all, with rest", "count": result.all_points.points, "fit": result.all_points})
    return lines


def _spreads(result: StaticPointsResult, output_unit: str) -> str:
    """Return the scatter of the samples behind the means, at rest and in rotation; empty if it is not known."""
    if not (math.isfinite(result.rest_std_v) and math.isfinite(result.rotating_std_v)):
        return ""
    rest, rotating = (
        text.with_unit(text.number(std, 2), output_unit) for std in (result.rest_std_v, result.rotating_std_v)
    )
    return f"The samples behind a mean scatter by {rest} at rest and by {rotating} in rotation (standard deviations)."


_CURVE_POINTS = 160
_LINE, _SINE = "raw", "joint"
"""The line has the colour of the raw error, the sine that of the last level."""


def points_figure(result: StaticPointsResult, points: StaticPoints, output_unit: str) -> Figure:
    """Plot means against commanded rate with line and sine through the rotating points, and the residuals in °/s."""
    fit, rate = result.rotating, points.rate_dps
    grid = np.linspace(rate.min(), rate.max(), _CURVE_POINTS)
    figure = new_figure(2.7)
    output, left = figure.subplots(1, 2)
    output.plot(
        grid,
        fit.line_U0_v + fit.line_K0_v_per_dps * grid,
        color=LEVEL_COLOURS[_LINE],
        linestyle="--",
        label="straight line",
    )
    sine = fit.U0_v + fit.K0_v_per_dps * np.sin(fit.S_rad_per_dps * grid) / fit.S_rad_per_dps
    output.plot(grid, sine, color=LEVEL_COLOURS[_SINE], label="sine law")
    output.plot(rate, points.mean_v, linestyle="none", marker="o", markersize=2.8, color=INK, label="means")
    output.set(xlabel="commanded rate (°/s)", ylabel=f"output ({output_unit})")
    output.set_title("output")
    output.legend(loc="best")
    for name, residual, label in (
        (_LINE, fit.residual_line_dps, "straight line"),
        (_SINE, fit.residual_sine_dps, "sine law"),
    ):
        left.plot(
            rate,
            residual,
            linestyle="none",
            marker=LEVEL_MARKERS[name],
            markersize=3.2,
            color=LEVEL_COLOURS[name],
            label=label,
        )
    left.axhline(0.0, color=INK, linewidth=0.5)
    left.set(xlabel="commanded rate (°/s)", ylabel="indicated less commanded rate (°/s)")
    left.set_title("what each law leaves")
    left.legend(loc="best")
    return figure
