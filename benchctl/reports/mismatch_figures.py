"""Figures of the mismatch between a recording and models of it: along a coordinate, per step, in an excerpt.

Every figure shows any number of models; each has the same colour and marker throughout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from benchctl.diagnosis.result import Slice, StepFigures, StructureModel, Trace
from benchctl.reports import diagnosis_words as words
from benchctl.reports.figures import GREY, INK, LEVEL_COLOURS, dots, new_figure
from benchctl.reports.reduction import binned
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.structure_places import ACTS

BAND = "#e4e7ea"
_TICKS = 7
_SHORT_S = 600.0
_FEWEST_LABELS = 3
_FINE_LABELS = (1, 1.2, 1.4, 1.6, 1.8, 2, 2.2, 2.5, 3, 3.5, 4, 4.5, 5, 6, 7, 8, 9)
_BLOCKS, _LEAST_BLOCK = 200, 8
"""Number of means that form the line through an excerpt's points, and the minimum of points per mean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """The style of one model in all figures."""

    label: str
    colour: str
    marker: str
    alpha: float = 1.0

    @property
    def key(self) -> Line2D:
        """The entry of the model in a legend of lines."""
        return Line2D(
            [],
            [],
            color=self.colour,
            alpha=self.alpha,
            marker=self.marker,
            markersize=2.5,
            linewidth=0.9,
            label=self.label,
        )


BEFORE = Look(label="before", colour=LEVEL_COLOURS["raw"], marker="o", alpha=0.55)
AFTER = Look(label="after", colour=LEVEL_COLOURS["joint"], marker="o")
AS_IT_CAME = Look(label="model as it came", colour=GREY, marker="x")

_SPOILT: dict[str, Any] = {"color": "#b3261e", "marker": "x", "markersize": 3.0, "linestyle": "none"}


def spoilt_key() -> Line2D:
    """Return the legend entry of spoilt samples."""
    return Line2D([], [], label="spoilt, left out", **_SPOILT)


@dataclass(frozen=True, slots=True, kw_only=True)
class StepMark:
    """A step in the figure of all steps: its start [s], and whether it is shaded."""

    t_start: float
    shaded: bool = False


def along(
    axes: Axes,
    coordinate: str,
    edges: FloatArray,
    means: Sequence[tuple[Look, FloatArray]],
    error: FloatArray,
    unit: str,
    *,
    chance: FloatArray | None = None,
) -> float:
    """Plot means (m,) of residuals [unit] in bins with m+1 edges, NaN if empty, ± their error; `chance` is a band.

    Returns the factor by which `unit` was multiplied, for additional curves.
    """
    largest = np.nanmax(np.abs([np.zeros(error.size), *(mean for _, mean in means)]))
    factor, shown = words.scaled(unit, float(largest))
    middle = bin_middles(coordinate, edges)
    if chance is not None:
        band = np.nan_to_num(factor * np.append(chance, chance[-1:]))
        axes.fill_between(edges, -band, band, step="post", color=BAND, linewidth=0)
    axes.axhline(0.0, color=INK, linewidth=0.5)
    for look, mean in means:
        held = np.isfinite(mean)
        axes.errorbar(
            middle[held],
            factor * mean[held],
            yerr=factor * np.nan_to_num(error[held]),
            color=look.colour,
            alpha=look.alpha,
            linewidth=0.9,
            marker=look.marker,
            markersize=2.2,
        )
    axes.set_xlabel(words.coordinate_axis(coordinate, unit), labelpad=1.5)
    axes.set_ylabel(shown, labelpad=1.5)
    axes.locator_params(axis="both", nbins=4)
    if coordinate == "rate_sign":
        axes.set_xticks((-1, 0, 1))
    if _is_logarithmic(coordinate, edges):
        axes.set_xscale("log")
    return factor


def bin_middles(coordinate: str, edges: FloatArray) -> FloatArray:
    """Return the midpoints of bins, geometric on a logarithmic axis; m+1 edges to (m,)."""
    if _is_logarithmic(coordinate, edges):
        return np.sqrt(edges[1:] * edges[:-1])
    return (edges[1:] + edges[:-1]) / 2


def step_by_step(
    axes: Axes, marks: Sequence[StepMark], rms: Sequence[tuple[Look, FloatArray]], noise: float, unit: str, shade: str
) -> None:
    """Plot the rms (m,) of each step's residual [unit] on a logarithmic scale; `shade` names the shaded steps."""
    place = np.arange(1, len(marks) + 1)
    factor, shown = words.scaled(unit, max(noise, *(float(np.median(values)) for _, values in rms)))
    for at, mark in zip(place, marks, strict=True):
        if mark.shaded:
            axes.axvspan(at - 0.5, at + 0.5, color=BAND, linewidth=0)
    for look, values in rms:
        axes.plot(
            place,
            factor * values,
            linestyle="none",
            marker=look.marker,
            markersize=3.0,
            color=look.colour,
            label=look.label,
        )
    axes.axhline(factor * noise, color=INK, linewidth=0.8, linestyle="--", label="noise")
    axes.set(yscale="log", ylabel=f"rms of the residual ({shown})", xlabel="step, and when it began")
    axes.set_xlim(0.3, len(marks) + 0.7)
    ticks = np.unique(np.linspace(1, len(marks), min(_TICKS, len(marks))).astype(int))
    clock = _clock if marks[-1].t_start >= _SHORT_S else lambda seconds: f"{seconds:.0f} s"
    axes.set_xticks(ticks, [f"{at}\n{clock(marks[at - 1].t_start)}" for at in ticks])
    _label_less_than_a_decade(axes)
    handles, labels = axes.get_legend_handles_labels()
    if any(mark.shaded for mark in marks):
        handles, labels = [*handles, Patch(color=BAND)], [*labels, shade]
    axes.figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))


def excerpt(
    output: Axes,
    left: Axes,
    time_s: FloatArray,
    measured: FloatArray,
    models: Sequence[tuple[Look, FloatArray]],
    unit: str,
    *,
    spoilt: BoolArray | None = None,
) -> None:
    """Plot a part of a step: measured and modelled output on one axis, residuals on the other; arrays (n,).

    Samples that are `spoilt` are marked in the first and omitted from the second.
    """
    time_s = time_s - time_s[0]
    dots(output, time_s, measured, INK)
    if spoilt is not None and spoilt.any():
        output.plot(time_s[spoilt], measured[spoilt], **_SPOILT)
    for look, values in models:
        output.plot(time_s, values, color=look.colour, linewidth=0.9)
    output.set_ylabel(f"measured ({unit})")
    counted = measured if spoilt is None else np.where(spoilt, np.nan, measured)
    residuals = [(look, counted - values) for look, values in models]
    factor, shown = words.scaled(unit, float(np.nanmax(np.abs(residuals[0][1]), initial=0.0)))
    for look, residual in residuals:
        dots(left, time_s, factor * residual, look.colour, size=1.4)
    blocks = max(1, min(_BLOCKS, time_s.size // _LEAST_BLOCK))
    for look, residual in residuals:
        means = binned(time_s, factor * residual, blocks)
        left.plot(means.centre, means.mean, color="white", linewidth=2.6)
        left.plot(means.centre, means.mean, color=look.colour, linewidth=1.3)
    left.axhline(0.0, color=INK, linewidth=0.5)
    left.set_xlim(output.get_xlim())
    left.set_ylabel(f"residual ({shown})")
    left.locator_params(axis="y", nbins=5)
    rms = [f"{factor * float(np.sqrt(np.nanmean(residual**2))):.3g}" for _, residual in residuals]
    left.set_title(f"rms {' → '.join(rms)} {shown}")


def _is_logarithmic(coordinate: str, edges: FloatArray) -> bool:
    return coordinate == "frequency" and bool(edges[0] > 0)


def _clock(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d}" if minutes >= 60 else f"{minutes} min"


def _label_less_than_a_decade(axes: Axes) -> None:
    """Label a logarithmic axis that spans little more than a decade at more values than powers of ten."""
    low, high = axes.get_ylim()
    if high / low < 100:
        powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        for steps in ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 8), _FINE_LABELS):
            ticks = [step * 10.0**power for power in powers for step in steps]
            shown = [tick for tick in ticks if low <= tick <= high]
            if len(shown) >= _FEWEST_LABELS:
                break
        axes.set_yticks(shown, [f"{tick:g}" for tick in shown])
        axes.minorticks_off()


ONLY = replace(AFTER, label="model, its own parameters refitted")
"""The style of the only model, if no finding changes its predictions."""
_BEYOND = "#b3261e"
_COLUMNS = 3


def significance(of: Slice, mean_v: FloatArray) -> float:
    """Return the largest |mean| in units of its standard error over all bins with samples; 0 without samples."""
    ratio = _in_errors(of, mean_v)
    ratio = ratio[np.isfinite(ratio)]
    return float(ratio.max()) if ratio.size else 0.0


def map_figure(slices: Sequence[Slice], unit: str, *, changed: bool = True) -> Figure:
    """Draw a panel per coordinate: means of the residual with standard errors, before and after, and the chance level.

    If nothing `changed`, only one model is drawn; the same applies to the other figures.
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
    """Plot the rms of each step's residual over time: of the model as it `came`, refitted, and with the findings."""
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
    """Plot excerpts, one per row: the output with the predictions, and the residuals of the samples used."""
    figure = new_figure(0.35 + 1.55 * len(traces))
    grid = figure.subplots(len(traces), 2, squeeze=False, width_ratios=(1.0, 1.8))
    for (output, left), trace in zip(grid, traces, strict=True):
        models = [(BEFORE, trace.before), (AFTER, trace.after)] if changed else [(ONLY, trace.after)]
        excerpt(output, left, trace.time_s, trace.measured, models, unit, spoilt=trace.spoilt)
        output.set_title(f"{trace.step} (held out)" if trace.heldout else trace.step)
    spoilt = [spoilt_key()] if any(trace.spoilt.any() for trace in traces) else []
    name_excerpts(figure, [*([BEFORE.key, AFTER.key] if changed else [ONLY.key]), *spoilt])
    return figure


def curve_figure(of: StructureModel, unit: str) -> Figure:
    """Plot an empirical model against the values from held-out steps with its band, and the residual in them."""
    curve = of.curve
    if curve is None:
        raise ValueError(f"{of.identifier}: there is no curve to draw")
    factor, per = next(acts.printed for stage, acts in ACTS.items() if stage == of.stage)
    per = unit if of.stage == "torque" else per  # the unit of a load may differ
    figure = new_figure(2.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    upper.fill_between(curve.along, factor * curve.low, factor * curve.high, color=BAND, linewidth=0)
    upper.plot(curve.along, factor * curve.fitted, color=AFTER.colour, linewidth=0.9)
    for axes, look, values in ((upper, BEFORE, curve.required), (lower, AFTER, curve.left)):
        axes.axhline(0.0, color=INK, linewidth=0.5)
        axes.errorbar(
            curve.place,
            factor * values,
            yerr=factor * curve.error,
            color=look.colour,
            alpha=look.alpha,
            marker=look.marker,
            markersize=2.2,
            linewidth=0.6,
            linestyle="none",
        )
        axes.set_ylabel(f"{look.label} ({per})", labelpad=1.5)
    lower.set_xlabel(words.coordinate_axis(of.coordinates[0].split("*")[0], unit), labelpad=1.5)
    return figure


def name_excerpts(figure: Figure, keys: Sequence[Line2D]) -> None:
    """Label the time axes of the lowest row of excerpts, and add the legend."""
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
    """Return |mean| in standard errors, (m,); NaN in bins without samples."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio: FloatArray = np.where(of.count > 0, np.abs(mean_v) / of.standard_error, np.nan)
    return ratio
