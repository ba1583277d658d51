"""Every fold at once: a rate beyond which the output turns back.

A fold has no size, and what it does between two of a procedure's rates depends on where exactly it lies: a few places
to begin from would miss it, or stand for another one. As it acts on the rate alone, the residual's pull is summed over
bins of the rate, and every fold is judged by those sums.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.search.pull import Place, Pull, peaks
from benchctl.diagnosis.signals.bins import bin_of
from instruments.physics.effects.fringe_ambiguity import folded_dps

FloatArray = npt.NDArray[np.float64]

_BINS = 2000
_FOLDS = 400
_LOWEST = 0.05
"""Share of the fastest rate that the lowest fold is looked for at."""
_APART = 8
_UNSURE = 3.0
"""By so much may the scale factor be wrong that a model without the fold was fitted to."""


def fold_places(pull: Pull, rate_dps: FloatArray, scale_v_per_dps: float, count: int) -> list[Place]:
    """The most promising folds [deg/s] for rates of shape (n,), the most promising first."""
    fastest = float(np.abs(rate_dps[pull.rows]).max())
    if fastest <= 0.0:
        return []
    edges = np.linspace(-fastest, fastest, _BINS + 1)
    middle = 0.5 * (edges[:-1] + edges[1:])
    place = bin_of(rate_dps, edges)

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(place, values, minlength=_BINS))

    folds = fastest * np.linspace(_LOWEST, 1.0, _FOLDS, endpoint=False)
    changes = scale_v_per_dps * np.stack([folded_dps(middle, fold) - middle for fold in folds.tolist()])
    score = changes @ summed(pull.pull)
    known = changes @ np.stack([summed(pull.of_known(i)) for i in range(len(pull.fitted.numbers))], axis=1)
    power = changes**2 @ summed(pull.information)
    own = np.maximum(power - np.einsum("fi,ij,fj->f", known, pull.fitted.inverse_information, known), 1e-300)
    share = np.clip(score / own, 1.0 / _UNSURE, _UNSURE)
    gain = np.maximum(share * (2.0 * score - share * own), 0.0)
    return [Place(float(folds[i]), float(gain[i]), float(_FOLDS)) for i in peaks(gain, count, _APART)]
