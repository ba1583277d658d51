"""Figures of the error at each level, from the straight line to the joint fit, and the table of runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchctl.calibration.result import CalibrationResult, Residuals, RunErrors
from benchctl.recordings.model import StepInfo
from benchctl.reports import text
from benchctl.reports.figures import (
    FAINT,
    INK,
    LEVEL_COLOURS,
    LEVEL_MARKERS,
    PATH_LEVELS,
    dots,
    level_names,
    new_figure,
)
from benchctl.reports.reduction import binned, spread, thinned
from benchctl.reports.setup_section import kind_name
from benchctl_instruments.arrays import FloatArray

_BINS = 24
_ONE_TEMPERATURE_C = 1.0


def shown_runs(result: CalibrationResult) -> list[RunErrors]:
    """Return the runs in motion whose error is shown: the held-out runs, or all if none was held out."""
    moving = [run for run in result.runs if run.peak_rate_dps > 0 and run.error_percent]
    return [run for run in moving if run.role == "verify"] or moving


def levels_figure(result: CalibrationResult) -> Figure:
    """Plot the largest error of each level in percent, on one logarithmic axis: against |rate|, temperature, time."""
    runs, left = shown_runs(result), result.residuals
    levels = level_names(tuple(left.residual_dps))
    hours = _hours(left, runs)
    figure = new_figure(2.5)
    by_rate, *others = figure.subplots(1, 3 if _temperatures_differ(runs) else 2, sharey=True)
    for level in levels:
        bins = binned(np.abs(left.rate_dps), _percent(left, runs, level), _BINS)
        drawn = bins.largest > 0
        by_rate.plot(bins.centre[drawn], bins.largest[drawn], label=PATH_LEVELS[level], **_look(level))
        errors = [run.error_percent.get(level, np.nan) for run in runs]
        for axes, x in zip(reversed(others), (hours, [run.temperature_c for run in runs]), strict=False):
            axes.plot(x, errors, linestyle="none", **_look(level))
    by_rate.set(xlabel="|rate| (°/s)", ylabel="largest error (%)", yscale="log")
    by_rate.set_title("against rate, in bins")
    _name_run_axes(others)
    figure.legend(*by_rate.get_legend_handles_labels(), loc="outside upper center", ncols=len(levels))
    return figure


def residual_rows_figure(result: CalibrationResult) -> Figure:
    """Plot residuals in °/s against rate, temperature and time: one row per level, each with its own scale."""
    left = result.residuals
    levels = level_names(tuple(left.residual_dps))
    coordinates = {"rate (°/s)": left.rate_dps, "temperature (°C)": left.temperature_c, "time (h)": left.time_s / 3600}
    if spread(left.temperature_c) < _ONE_TEMPERATURE_C:
        del coordinates["temperature (°C)"]
    figure = new_figure(0.5 + 1.15 * len(levels))
    grid = figure.subplots(len(levels), len(coordinates), sharex="col", sharey="row", squeeze=False)
    for row, level in zip(grid, levels, strict=True):
        for axes, x in zip(row, coordinates.values(), strict=True):
            _scatter(axes, x, left.residual_dps[level], left.verify, LEVEL_COLOURS[level])
        row[0].set_ylabel("error (°/s)")
        row[0].set_title(PATH_LEVELS[level], color=INK, fontweight="bold")
    for axes, label in zip(grid[-1], coordinates, strict=True):
        axes.set_xlabel(label)
    figure.align_ylabels(grid[:, 0])
    return figure


def _scatter(axes: Axes, x: FloatArray, y: FloatArray, verify: npt.NDArray[np.bool_], colour: str) -> None:
    for mask, shade in ((~verify, FAINT), (verify, colour)) if verify.any() else ((~verify, colour),):
        points = thinned(x[mask], y[mask])
        dots(axes, x[mask][points], y[mask][points], shade)
    axes.axhline(0.0, color=INK, linewidth=0.5)
    axes.margins(x=0.03, y=0.08)


def _percent(left: Residuals, runs: list[RunErrors], level: str) -> FloatArray:
    """Return the residual in percent of the run's largest rate; NaN in runs that are not shown; shape (n,)."""
    peak = np.full(int(left.step.max(initial=0)) + 1, np.nan)
    for run in runs:
        peak[run.step] = run.peak_rate_dps
    return np.asarray(100.0 * left.residual_dps[level] / peak[left.step])


def _hours(left: Residuals, runs: list[RunErrors]) -> list[float]:
    """Return the time of each run, h. A step may be cut into several runs: the n-th is its n-th contiguous part."""
    edges = np.flatnonzero(np.diff(left.step) | np.diff(left.verify)) + 1
    stretches: dict[tuple[int, bool], list[float]] = {}
    for stretch in np.split(np.arange(left.step.size), edges):
        key = int(left.step[stretch[0]]), bool(left.verify[stretch[0]])
        stretches.setdefault(key, []).append(float(left.time_s[stretch].mean()) / 3600)
    found = []
    for run in runs:
        times = stretches[run.step, run.role == "verify"]
        found.append(times.pop(0) if len(times) > 1 else times[0])
    return found


def _temperatures_differ(runs: list[RunErrors]) -> bool:
    return spread(np.array([run.temperature_c for run in runs])) >= _ONE_TEMPERATURE_C


def _name_run_axes(others: list[Axes]) -> None:
    others[-1].set(xlabel="time (h)")
    others[-1].set_title("against time, run by run")
    for axes in others[:-1]:
        axes.set(xlabel="temperature (°C)")
        axes.set_title("against temperature, run by run")


def _look(level: str) -> dict[str, Any]:
    return {"color": LEVEL_COLOURS[level], "marker": LEVEL_MARKERS[level], "markersize": 3.0}


_MOST_RUNS = 60


def run_table(result: CalibrationResult, infos: Sequence[StepInfo]) -> dict[str, object] | None:
    """Return the table of the held-out runs, or of the fitted ones if none was held out; None without runs."""
    runs = shown_runs(result)
    if not runs:
        return None
    levels = tuple(level_names(tuple({level for run in runs for level in run.error_percent})))
    by_index = {info.index: info for info in infos}
    lines = [
        {
            "step": run.step,
            "kind": kind_name(by_index[run.step].kind if run.step in by_index else run.kind),
            "temperature": text.plain(run.temperature_c),
            "peak_rate": text.plain(run.peak_rate_dps),
            "frequency": text.plain(by_index[run.step].frequency_hz if run.step in by_index else None, decimals=3),
            "errors": tuple(
                (text.number(run.error_percent.get(level), 2), text.number(run.rms_percent.get(level), 2))
                for level in levels
            ),
        }
        for run in runs[:_MOST_RUNS]
    ]
    verified = runs[0].role == "verify"
    return {"verified": verified, "levels": levels, "lines": tuple(lines), "left_out": len(runs) - len(lines)}
