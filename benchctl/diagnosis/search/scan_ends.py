"""Every fold and every limit at once: a rate beyond which the output turns back, an output that is not exceeded.

Neither has a size, and what it does between two of a procedure's rates depends on where exactly it lies: a few places
to begin from would miss it, or stand for another one; and a fit that goes beyond the largest output finds no way back.
As each acts on one coordinate alone, the rate or the output, the residual's pull is summed over bins of it, and every
place is judged by those sums.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.search.pull import Place, Pull, peaks
from benchctl.diagnosis.signals.bins import bin_of
from instruments.physics.effects.fringe_ambiguity import folded_dps

FloatArray = npt.NDArray[np.float64]

_BINS = 2000
_PLACES = 400
_LOWEST = 0.05
"""Share of the fastest rate, or the largest output, that the lowest place is looked for at."""
_APART = 8
_UNSURE = 3.0
"""By so much may the scale factor be wrong that a model without the fold was fitted to."""


def fold_places(pull: Pull, rate_dps: FloatArray, scale_v_per_dps: float, count: int) -> list[Place]:
    """The most promising folds [deg/s] for rates of shape (n,), the most promising first."""

    def change(rates: FloatArray, fold: float) -> FloatArray:
        return scale_v_per_dps * (folded_dps(rates, fold) - rates)

    return _places(pull, rate_dps, change, count)


def limit_places(pull: Pull, output_v: FloatArray, count: int) -> list[Place]:
    """The most promising limits [V] of predicted outputs of shape (n,), the most promising first."""

    def change(outputs: FloatArray, limit: float) -> FloatArray:
        return np.clip(outputs, -limit, limit) - outputs

    return _places(pull, output_v, change, count)


def _places(
    pull: Pull, coordinate: FloatArray, change: Callable[[FloatArray, float], FloatArray], count: int
) -> list[Place]:
    """The most promising ends of a coordinate of shape (n,); `change` is what one does at values of it."""
    largest = float(np.abs(coordinate[pull.rows]).max())
    if largest <= 0.0:
        return []
    edges = np.linspace(-largest, largest, _BINS + 1)
    middle = 0.5 * (edges[:-1] + edges[1:])
    bins = bin_of(coordinate, edges)

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(bins, values, minlength=_BINS))

    ends = largest * np.linspace(_LOWEST, 1.0, _PLACES, endpoint=False)
    changes = np.stack([change(middle, end) for end in ends.tolist()])
    score = changes @ summed(pull.pull)
    known = changes @ np.stack([summed(pull.of_known(i)) for i in range(len(pull.fitted.numbers))], axis=1)
    power = changes**2 @ summed(pull.information)
    own = np.maximum(power - np.einsum("fi,ij,fj->f", known, pull.fitted.inverse_information, known), 1e-300)
    share = np.clip(score / own, 1.0 / _UNSURE, _UNSURE)
    gain = np.maximum(share * (2.0 * score - share * own), 0.0)
    return [Place(float(ends[i]), float(gain[i]), float(_PLACES)) for i in peaks(gain, count, _APART)]
