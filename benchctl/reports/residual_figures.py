"""What the last level leaves: noise, or still a shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchctl.calibration.result import CalibrationResult
from benchctl.reports.figures import FAINT, GREY, INK, LEVEL_COLOURS, dots, level_names, new_figure
from benchctl.reports.law_curves import Z95
from benchctl.reports.reduction import binned, spread, thinned
from benchctl_instruments.arrays import FloatArray

_BINS = 24
_FEWEST_FOR_A_HISTOGRAM = 50


def last_level(result: CalibrationResult) -> str | None:
    """The last level of the path that was reached."""
    reached = level_names(tuple(result.residuals.residual_dps))
    return reached[-1] if reached else None


def final_residuals_figure(result: CalibrationResult, level: str) -> Figure:
    """Residuals of one level in 0.001 °/s: with binned means against rate and acceleration, and their distribution.

    Drawn are the runs kept aside, or all where there are none.
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
    panels[0].set_ylabel("what is left (0.001 °/s)")
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
    """What bears a label, each label once."""
    found: dict[str, Artist] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values())
