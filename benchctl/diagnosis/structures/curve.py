"""A structure's function as it is drawn: beside what the residual of held-out steps asks of it, and with its band."""

from __future__ import annotations

import numpy as np

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.result import Curve
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.structures.scan import coordinates_of, factors_of
from benchctl.signals.binning import bin_of
from benchctl.signals.normal import Z95
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.structures import Structure

_BINS, _POINTS = 60, 400
_NUDGE = 1e-4
_FEWEST = 10


def curve_of(problem: GyroProblem, chosen: Selection, key: str) -> Curve | None:
    """What is drawn of a structure of a selection; None of one that is no function of the present alone."""
    after = chosen.after
    place = keys_of(after.point.effects).index(key)
    effect = after.point.effects[place]
    coordinates, factors = coordinates_of(problem), factors_of(problem, after)
    if not isinstance(effect, Structure) or not effect.pointwise:
        return None
    if effect.acts_on not in factors or effect.over not in coordinates:
        return None
    x, factor = coordinates[effect.over], factors[effect.acts_on]
    if effect.times:
        factor = factor * coordinates[effect.times]
    rows = chosen.whitener.weight > 0.0
    rows &= chosen.heldout[problem.step] if chosen.heldout.any() else True
    x, factor, residual = x[rows], factor[rows], after.residual[rows]
    if not x.size or not np.ptp(x) > 0.0:
        return None
    span = float(x.min()), float(x.max())
    bins = bin_of(x, np.linspace(*span, _BINS + 1))

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(bins, values, minlength=_BINS), dtype=np.float64)

    power, count = summed(factor**2), np.bincount(bins, minlength=_BINS)
    seen = (count >= _FEWEST) & (power > 1e-6 * float(power.max()))
    power = power[seen]
    left = summed(factor * residual)[seen] / power
    along = np.linspace(*span, _POINTS)
    fitted, error = effect.value_at(along), _error(problem, chosen, place, effect, along)
    return Curve(
        place=summed(x)[seen] / count[seen],
        asked=left + summed(factor**2 * effect.value_at(x))[seen] / power,
        left=left,
        error=chosen.white_deviation / np.sqrt(power),
        along=along,
        fitted=fitted,
        low=fitted - Z95 * error,
        high=fitted + Z95 * error,
    )


def _error(problem: GyroProblem, chosen: Selection, place: int, effect: Structure, along: FloatArray) -> FloatArray:
    """Standard error of the function at places (k,), by the covariance of the structure's numbers."""
    after = chosen.after
    mine = [i for i, one in enumerate(after.numbers) if one.effect == place]
    if not mine:
        return np.zeros_like(along)
    covariance = after.robust_covariance(problem.step)[np.ix_(mine, mine)]
    columns = []
    for number in (after.numbers[i] for i in mine):
        parameter, value = effect.parameters[number.name], effect.values[number.name]
        nudge = _NUDGE * (abs(value) or 1.0)
        moved = type(effect).make({**effect.values, number.name: value + nudge})
        slope = (moved.value_at(along) - effect.value_at(along)) / nudge
        columns.append(slope * value if parameter.logarithmic else slope)
    slopes = np.stack(columns)
    return np.asarray(np.sqrt(np.maximum(np.einsum("ak,ab,bk->k", slopes, covariance, slopes), 0.0)))
