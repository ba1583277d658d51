"""Where a mismatch lives: the residual sliced along each coordinate, before and after, and step by step."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.bins import bin_of
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.result import Slice, StepFigures, Where
from benchctl.diagnosis.select import Selection

_BINS = 40
_COARSE_BINS = 10
_CHANCE_DEVIATIONS = 4.0
_MOST_OF_EXCESS = 0.8


def slices_of(problem: Problem, chosen: Selection) -> tuple[Slice, ...]:
    """The residual's mean in bins of every coordinate that the recording varies."""
    rows = problem.usable
    deviation = chosen.after.deviation
    slices = []
    for name, values in problem.coordinates.items():
        known = rows & np.isfinite(values)
        if not known.any() or float(np.ptp(values[known])) == 0.0:
            continue
        low, high = np.quantile(values[known], [0.0005, 0.9995])
        if low >= high:
            continue
        edges = np.linspace(low, high, _BINS + 1)
        place = bin_of(values[known], edges)
        count = np.bincount(place, minlength=_BINS).astype(np.float64)
        least = np.maximum(count, 1.0)
        before = np.bincount(place, chosen.before.residual[known], minlength=_BINS) / least
        after = np.bincount(place, chosen.after.residual[known], minlength=_BINS) / least
        slices.append(
            Slice(
                coordinate=name,
                edges=edges,
                count=count,
                before_v=before,
                after_v=after,
                standard_error_v=deviation / np.sqrt(least),
                threshold=_CHANCE_DEVIATIONS,
            )
        )
    return tuple(slices)


def where_of(problem: Problem, excess: npt.NDArray[np.float32], coordinate: str) -> Where:
    """The ranges of a coordinate, and the steps, that hold most of an `excess` of squares, shape (n,)."""
    per_step = np.bincount(problem.step, excess, minlength=len(problem.step_names))
    steps = tuple(problem.step_names[i] for i in np.argsort(-per_step)[:3])
    values = problem.coordinates.get(coordinate.split("*")[0])
    if values is None or not np.isfinite(values).all():
        return Where(coordinate=coordinate, steps=steps)
    edges = np.linspace(float(values.min()), float(values.max()), _COARSE_BINS + 1)
    place = bin_of(values, edges)
    held = np.maximum(np.bincount(place, excess, minlength=_COARSE_BINS), 0.0)
    total = float(held.sum())
    if total <= 0.0:
        return Where(coordinate=coordinate, steps=steps)
    order = np.argsort(-held)
    needed = int(np.searchsorted(np.cumsum(held[order]), _MOST_OF_EXCESS * total)) + 1
    kept = sorted(order[:needed].tolist())
    ranges = tuple((float(edges[i]), float(edges[i + 1])) for i in kept)
    return Where(coordinate=coordinate, ranges=ranges, steps=steps, share_of_excess=float(held[kept].sum()) / total)


def step_figures(problem: Problem, chosen: Selection) -> tuple[StepFigures, ...]:
    """Every step's rms residual: by the model as it came, refitted, and with the findings."""
    came = problem.measured - problem.predict(problem.baseline_start, ())
    rows = np.bincount(problem.step, problem.usable, minlength=len(problem.step_names))

    def rms(residual: np.typing.NDArray[np.float64]) -> list[float]:
        squares = np.bincount(problem.step, residual**2 * problem.usable, minlength=rows.size)
        return [math.sqrt(value) for value in (squares / np.maximum(rows, 1)).tolist()]

    columns = zip(
        problem.steps,
        chosen.heldout.tolist(),
        rms(came),
        rms(chosen.before.residual),
        rms(chosen.after.residual),
        strict=True,
    )
    return tuple(
        StepFigures(
            name=info.name,
            kind=info.kind,
            t_start=info.t_start,
            t_end=info.t_end,
            heldout=held,
            as_it_came_v=as_it_came,
            before_v=before,
            after_v=after,
        )
        for info, held, as_it_came, before, after in columns
    )
