"""Fit quality: rms of a model's residual, compared with the noise of the recording itself."""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import chi2

from benchctl.diagnosis.findings.located import left_of, where_of
from benchctl.diagnosis.result import FitFigures, Unexplained
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.disturbance import disturbance_of_fit
from benchctl.estimation.noise_model import between_rows
from benchctl_instruments.arrays import BoolArray, FloatArray

_FAR_ABOVE = 2.0
"""Residual, relative to the noise, above which a model does not agree with a recording."""
_BLOCK_S, _FEWEST = 1.0, 20
"""Block length and minimum rows for the line fitted at rest; within it a drift of the bias is linear."""


def figures_of(problem: PartProblem, chosen: Selection) -> FitFigures:
    """Return the rms of residuals over rows that count: with refitted parameters only, and with the findings.

    If the noise wanders, a row is predicted from the rows before it. The noise never exceeds the residual.
    """
    counted = chosen.whitener.weight > 0.0
    heldout = chosen.heldout[problem.step] & counted
    fitted = counted & ~heldout
    before, after = chosen.before.residual, left_of(problem, chosen.after, chosen.whitener)
    named = after if chosen.named is None else left_of(problem, chosen.named, chosen.whitener)
    noise = noise_of(problem, chosen)
    return FitFigures(
        unit=problem.unit,
        noise=min(_rms(after[fitted]), math.inf if noise is None else noise),
        before=_rms(before[fitted]),
        after=_rms(after[fitted]),
        heldout_before=_rms(before[heldout]),
        heldout_named=_rms(named[heldout]),
        heldout_after=_rms(after[heldout]),
    )


def beyond_noise(problem: PartProblem, chosen: Selection) -> Unexplained | None:
    """Return a residual far above the noise that depends on no coordinate: where in time most of it is; else None.

    A single burst, in which for example a table slips, is structure for none of the tests along coordinates. A
    disturbance of a chamber's air is part of its model and not a residual; commanded rates may be wrong.
    """
    counted = chosen.whitener.weight > 0.0
    noise = math.hypot(noise_of(problem, chosen) or 0.0, problem.rate_error_v)
    squares = np.where(counted, left_of(problem, chosen.after, chosen.whitener) ** 2, 0.0)
    ratio = _rms(np.sqrt(squares[counted])) / noise if noise else 0.0
    if problem.disturbed or ratio < _FAR_ABOVE:
        return None
    where = where_of(problem, squares.astype(np.float32), "time")
    sentence = f"The residual is {ratio:.2g} times the noise and depends on no coordinate that was tested"
    if where.ranges:
        spans = " and ".join(f"{low:.4g} to {high:.4g} s" for low, high in where.ranges)
        sentence += f"; {where.share_of_excess:.0%} of its square is at {spans}"
    return Unexplained(significant=True, share=1.0 - ratio**-2.0, coordinates=("time",), says=f"{sentence}.")


def noise_of(problem: PartProblem, chosen: Selection) -> float | None:
    """Return the rms of the noise of the measured quantity, independent of any model.

    It is computed from rest if there is any, from replicates of a rate if each row is a separate step, or else from
    differences between neighbouring rows of the residual. Return None if the recording has none of these.
    """
    counted = chosen.whitener.weight > 0.0
    if problem.step.size == len(problem.step_names):
        return _scatter_of_replicates(problem.measured[counted], problem.coordinates["rate"][counted])
    if problem.disturbed:
        return disturbance_of_fit(problem, chosen.after).white
    resting = np.array([kind == "static" for kind in problem.step_kinds])[problem.step] & counted
    at_rest = _about_lines(problem, resting)
    return at_rest if at_rest is not None else between_rows(problem, chosen.after.residual) or None


def _scatter_of_replicates(values: FloatArray, rate_dps: FloatArray) -> float | None:
    """Return the scatter of values (n,) about the mean of those with the same rate; None without replicates."""
    _, group, count = np.unique(np.round(rate_dps, 6), return_inverse=True, return_counts=True)
    freedom = values.size - count.size
    if freedom < 1:
        return None
    about = values - (np.bincount(group, values) / count)[group]
    return math.sqrt(float(about @ about) / freedom)


def _about_lines(problem: PartProblem, rows: BoolArray) -> float | None:
    """Return the scatter at rest about a line per second; the median, because in some seconds the table stops."""
    block = max(_FEWEST, round(_BLOCK_S / problem.interval_s))
    place = np.arange(block) - 0.5 * (block - 1)
    squares = []
    for stretch in problem.stretches:
        known, values = (column[stretch] for column in (rows, problem.measured))
        shape = (known.size // block, block)
        cut = known.size // block * block
        values = values[:cut].reshape(shape)[known[:cut].reshape(shape).all(axis=1)]
        values = values - values.mean(axis=1, keepdims=True)
        slope = values @ place / float(place @ place)
        squares.append(((values - slope[:, None] * place) ** 2).sum(axis=1))
    all_of_them = np.concatenate(squares)
    if not all_of_them.size:
        return None
    return math.sqrt(float(np.median(all_of_them)) / float(chi2.median(block - 2)))


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(values @ values) / values.size) if values.size else math.nan
