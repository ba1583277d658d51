"""Figures of a diagnosis: the map of the mismatch, the steps in the order of time, and excerpts of held-out steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from benchctl.diagnosis.result import Slice, StepFigures, Trace
from benchctl.reports.figures import INK, new_figure
from benchctl.reports.mismatch_figures import (
    AFTER,
    AS_IT_CAME,
    BAND,
    BEFORE,
    StepMark,
    along,
    bin_middles,
    excerpt,
    spoilt_key,
    step_by_step,
)
from benchctl_instruments.arrays import FloatArray

ONLY = replace(AFTER, label="model, its own parameters refitted")
"""How the one model is drawn where nothing was found that changes what it predicts."""
_BEYOND = "#b3261e"
_COLUMNS = 3


def significance(of: Slice, mean_v: FloatArray) -> float:
    """The largest |mean| over its standard error in any bin that holds samples; 0 where none does."""
    ratio = _in_errors(of, mean_v)
    ratio = ratio[np.isfinite(ratio)]
    return float(ratio.max()) if ratio.size else 0.0


def map_figure(slices: Sequence[Slice], unit: str, *, changed: bool = True) -> Figure:
    """A panel a coordinate: means of the residual with their standard errors, before and after, and what is chance.

    Where nothing `changed` there is one model only; so in the other figures.
    """
    rows = math.ceil(len(slices) / _COLUMNS)
    figure = new_figure(0.35 + 1.5 * rows)
    panels = list(figure.subplots(rows, _COLUMNS, squeeze=False).flat)
    for axes, of in zip(panels, slices, strict=False):
        _panel(axes, of, unit, changed)
    for axes in panels[len(slices) :]:
        axes.set_axis_off()
    label = "after, beyond chance" if changed else "beyond chance"
    beyond = Line2D([], [], color=_BEYOND, marker="D", markersize=3.5, linestyle="none", label=label)
    chance = Patch(color=BAND, label="what chance may do")
    models = [BEFORE.key, AFTER.key] if changed else [ONLY.key]
    figure.legend(handles=[*models, beyond, chance], loc="outside upper center", ncols=4)
    return figure


def steps_figure(
    steps: Sequence[StepFigures], noise: float, unit: str, *, changed: bool = True, came: bool = True
) -> Figure:
    """Rms of each step's residual, in the order of time: as the model `came`, refitted, and with the findings."""
    ordered = sorted(steps, key=lambda step: step.t_start)
    figure = new_figure(2.4)
    models = [(AFTER if changed else ONLY, np.array([step.after for step in ordered]))]
    if changed:
        models.insert(0, (BEFORE, np.array([step.before for step in ordered])))
    if came:
        models.insert(0, (AS_IT_CAME, np.array([step.as_it_came for step in ordered])))
    step_by_step(
        figure.subplots(),
        [StepMark(t_start=step.t_start, shaded=step.heldout) for step in ordered],
        models,
        noise,
        unit,
        "held out",
    )
    return figure


def traces_figure(traces: Sequence[Trace], unit: str, *, changed: bool = True) -> Figure:
    """Excerpts, a row each: the output with the predictions, and what these leave of the samples that count."""
    figure = new_figure(0.35 + 1.55 * len(traces))
    grid = figure.subplots(len(traces), 2, squeeze=False, width_ratios=(1.0, 1.8))
    for (output, left), trace in zip(grid, traces, strict=True):
        models = [(BEFORE, trace.before), (AFTER, trace.after)] if changed else [(ONLY, trace.after)]
        excerpt(output, left, trace.time_s, trace.measured, models, unit, spoilt=trace.spoilt)
        output.set_title(f"{trace.step} (held out)" if trace.heldout else trace.step)
    spoilt = [spoilt_key()] if any(trace.spoilt.any() for trace in traces) else []
    name_excerpts(figure, [*([BEFORE.key, AFTER.key] if changed else [ONLY.key]), *spoilt])
    return figure


def name_excerpts(figure: Figure, keys: Sequence[Line2D]) -> None:
    """Label the time axes of the lowest row of excerpts, and say what is drawn."""
    for axes in figure.axes[-2:]:
        axes.set_xlabel("time in the excerpt (s)")
    measured = Line2D([], [], color=INK, marker=".", linestyle="none", label="measured")
    figure.legend(handles=[measured, *keys], loc="outside upper center", ncols=1 + len(keys))


def _panel(axes: Axes, of: Slice, unit: str, changed: bool) -> None:
    held = of.count > 0
    before, after = (np.where(held, mean, np.nan) for mean in (of.before, of.after))
    chance = of.threshold * of.standard_error
    models = [(BEFORE, before), (AFTER, after)] if changed else [(ONLY, after)]
    factor = along(axes, of.coordinate, of.edges, models, of.standard_error, unit, chance=chance)
    beyond = _in_errors(of, of.after) > of.threshold
    middle = bin_middles(of.coordinate, of.edges)
    axes.plot(middle[beyond], factor * of.after[beyond], linestyle="none", marker="D", markersize=3.5, color=_BEYOND)
    largest = [significance(of, mean) for mean in (of.before, of.after)]
    axes.set_title(
        " → ".join(f"{one:.{0 if one >= 9.95 else 1}f}" for one in largest[0 if changed else 1 :]),
        loc="right",
        color=_BEYOND if beyond.any() else INK,
        fontweight="bold" if max(largest) > of.threshold else "normal",
        fontsize=7,
        pad=2.5,
    )


def _in_errors(of: Slice, mean_v: FloatArray) -> FloatArray:
    """|mean| in standard errors, (m,); NaN in bins without samples."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio: FloatArray = np.where(of.count > 0, np.abs(mean_v) / of.standard_error, np.nan)
    return ratio
