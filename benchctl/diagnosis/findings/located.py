"""Where a mismatch occurs: the residual along each coordinate, before and after, and per step."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from benchctl.diagnosis.result import Slice, StepFigures, Where
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Fit, judged
from benchctl.estimation.noise import Whitener
from benchctl.side_by_side import shared_out
from benchctl.signals.binning import bin_of
from benchctl_instruments.arrays import FloatArray

_BINS = 41
"""An odd number, so that zero rate, where most rows are, is in the middle of a bin."""
_COARSE_BINS = 10
_RARE = 0.0005
"""Share of the rows at either end that is included in the outermost bin."""
_CHANCE = 0.01
"""Probability that chance alone makes the mean of any bin of the complete map exceed the threshold."""
_MOST_OF_EXCESS = 0.8


def left_of(problem: PartProblem, fit: Fit, whitener: Whitener) -> FloatArray:
    """Return the residual of every row, shape (n,).

    If the noise wanders, rows that count are predicted from the rows before them.
    """
    if not whitener.slow or problem.disturbed:
        return fit.residual
    counted = whitener.weight > 0.0
    return np.divide(fit.white, whitener.weight, out=fit.residual.copy(), where=counted)


def slices_of(problem: PartProblem, chosen: Selection) -> tuple[Slice, ...]:
    """Return the mean residual in bins of every coordinate that varies in the recording."""
    residuals = chosen.before.residual, left_of(problem, chosen.after, chosen.whitener)

    def along(coordinate: tuple[str, FloatArray]) -> Slice | None:
        name, known_values = coordinate
        values = _without_noise(name, problem, chosen, known_values)
        return _slice_of(name, values, residuals, chosen.whitener.weight, chosen.after.deviation)

    slices = [one for one in shared_out(along, problem.coordinates.items()) if one is not None]
    bins = sum(int((one.count > 0).sum()) for one in slices)
    return tuple(replace(one, threshold=float(ndtri(1.0 - 0.5 * _CHANCE / bins))) for one in slices)


def _slice_of(
    name: str, values: FloatArray, residuals: tuple[FloatArray, FloatArray], weight: FloatArray, deviation: float
) -> Slice | None:
    """Return the slice of one coordinate, without threshold, from residuals before and after; None if constant."""
    known = (weight > 0.0) & np.isfinite(values)
    edges = _edges(values[known])
    if edges is None:
        return None
    place = bin_of(values[known], edges)
    count = np.bincount(place, minlength=edges.size - 1).astype(np.float64)
    least = np.maximum(count, 1.0)
    before, after = (np.bincount(place, one[known], minlength=count.size) / least for one in residuals)
    variance = np.bincount(place, weight[known] ** -2.0, minlength=count.size) / least
    return Slice(
        coordinate=name,
        edges=edges,
        count=count,
        before=before,
        after=after,
        standard_error=deviation * np.sqrt(variance / least),
        threshold=math.inf,
    )


def _without_noise(name: str, problem: PartProblem, chosen: Selection, values: FloatArray) -> FloatArray:
    """Return a coordinate, predicted if it is the measured quantity: sorting noise by itself makes a structure."""
    if name == "output":
        return chosen.after.predicted
    return np.gradient(chosen.after.predicted) / problem.interval_s if name == "chamber_temp_rate" else values


def _edges(values: FloatArray) -> FloatArray | None:
    """Return bin edges: around each value if these are few integers; None if the values do not vary."""
    if values.size == 0 or float(np.ptp(values)) == 0.0:
        return None
    if np.array_equal(values, np.rint(values)) and np.ptp(values) < _BINS:
        return np.arange(values.min() - 0.5, values.max() + 1.0)
    low, high = np.quantile(values, [_RARE, 1.0 - _RARE])
    return np.linspace(low, high, _BINS + 1) if low < high else None


def where_of(problem: PartProblem, excess: npt.NDArray[np.float32], coordinate: str) -> Where:
    """Return the ranges of a coordinate, and the steps, that hold most of an `excess` of squares, shape (n,)."""
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
    return Where(
        coordinate=coordinate,
        ranges=_joined(kept, edges.tolist()),
        steps=steps,
        share_of_excess=float(held[kept].sum()) / total,
    )


def _joined(kept: list[int], edges: list[float]) -> tuple[tuple[float, float], ...]:
    """Return the ranges of bins in increasing order, with adjacent ones joined."""
    starts = [i for i in kept if i - 1 not in kept]
    stops = [i + 1 for i in kept if i + 1 not in kept]
    return tuple((edges[start], edges[stop]) for start, stop in zip(starts, stops, strict=True))


def step_figures(problem: PartProblem, chosen: Selection) -> tuple[StepFigures, ...]:
    """Return every step's rms residual: with the original model, refitted, and with the findings.

    Innovations are used, weighted per row if the noise level varies, as in `FitFigures`.
    """
    came = problem.measured - problem.predict(problem.baseline_start, ())
    came = np.where(problem.usable, came, 0.0) if problem.disturbed else chosen.noise.plain(came)
    rows = np.bincount(problem.step, chosen.whitener.weight > 0.0, minlength=len(problem.step_names))

    def rms(white: FloatArray) -> list[float]:
        squares = np.bincount(problem.step, white**2, minlength=rows.size)
        return [math.sqrt(value) for value in (squares / np.maximum(rows, 1)).tolist()]

    columns = zip(
        problem.steps,
        chosen.heldout.tolist(),
        rms(came),
        rms(judged(problem, chosen.before)),
        rms(judged(problem, chosen.after)),
        strict=True,
    )
    return tuple(
        StepFigures(
            name=info.name,
            kind=info.kind,
            t_start=info.t_start,
            t_end=info.t_end,
            heldout=held,
            as_it_came=as_it_came,
            before=before,
            after=after,
        )
        for info, held, as_it_came, before, after in columns
    )
