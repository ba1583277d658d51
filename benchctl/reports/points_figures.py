"""Figures of a table of static points: output against rate, and what a line and a sine leave of it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from benchctl.calibration.static_points_fit import StaticPointsResult
from benchctl.recordings.static_points import StaticPoints
from benchctl.reports.figures import INK, LEVEL_COLOURS, LEVEL_MARKERS, new_figure

_CURVE_POINTS = 160
_LINE, _SINE = "raw", "joint"
"""The line has the colour of the raw error, the sine that of the last level."""


def points_figure(result: StaticPointsResult, points: StaticPoints, output_unit: str) -> Figure:
    """Means against commanded rate with line and sine through the rotating points, and what these leave in °/s."""
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
