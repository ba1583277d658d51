"""The pull of a fit's residual: the gain of any change of the prediction, from sums over rows without filtering again.

With the residual r and the noise's whitening W, twice the log likelihood gains (p·c)²/(c·i·c) from a column c in the
prediction, where p = Wᵀ·W·r/σ² is the pull of the rows and i, their information, is weight²/σ² if the filter W leaves c
unchanged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Fit
from benchctl.estimation.noise import Whitener
from benchctl_instruments.arrays import BoolArray, FloatArray

CELLS = 8
"""Number of cells into which a period is divided."""

_FEWEST_A_PERIOD, _MANY, _LONGER = 2.0, 100.0, 1.25
"""Smallest mean number of separate values in a period, unless there are many of them in all; ratio of the periods that
are tried for it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pull:
    """`rows` (n,) are the rows of the fitted steps that count; `pull` and `information` (n,) are 0 elsewhere."""

    whitener: Whitener
    fitted: Fit
    rows: BoolArray
    pull: FloatArray
    information: FloatArray

    def of_known(self, index: int) -> FloatArray:
        """Return the pull, shape (n,), of the derivative by free parameter `index`, used in place of the residual."""
        pulled = _back(self.whitener, self.fitted.derivatives[:, index] * self.rows)
        pulled /= self.fitted.deviation
        return pulled


@dataclass(frozen=True, slots=True)
class Place:
    """A proposed value of a shape parameter, its promised gain, and the number of places it was selected from."""

    value: float
    gain: float
    places: float


def pull_of(problem: PartProblem, whitener: Whitener, fitted: Fit) -> Pull:
    """Return the pull of a fit's residual, over the steps to which it was fitted."""
    rows = fitted.fitted[problem.step] & (whitener.weight > 0.0)
    return Pull(
        whitener=whitener,
        fitted=fitted,
        rows=rows,
        pull=np.where(rows, _back(whitener, np.where(rows, fitted.white, 0.0)), 0.0) / fitted.deviation**2,
        information=np.where(rows, (whitener.weight / fitted.deviation) ** 2, 0.0),
    )


def unweighted(whitener: Whitener, values: FloatArray) -> FloatArray:
    """Apply the whitening filter without weights, to rows without gaps, shape (n,)."""
    plain = replace(whitener, weight=np.ones_like(values), time_s=np.zeros(0))
    return plain(values)


def _back(whitener: Whitener, values: FloatArray) -> FloatArray:
    """Apply the transpose of the whitening: the same filter, run backwards."""
    return unweighted(whitener, (values * whitener.weight)[::-1])[::-1]


def peaks(gain: FloatArray, count: int, apart: int) -> list[int]:
    """Return indices of the largest values of (m,), the largest first, none closer than `apart` to a larger one."""
    left = gain.copy()
    found: list[int] = []
    while len(found) < count:
        best = int(np.argmax(left))
        if not left[best] > 0.0:
            break
        found.append(best)
        left[max(best - apart, 0) : best + apart + 1] = 0.0
    return found


def between(gain: FloatArray, index: int) -> float:
    """Return the position, in indices, of the maximum of the parabola through a peak and its neighbours."""
    if not 0 < index < gain.size - 1:
        return float(index)
    before, top, after = gain[index - 1 : index + 2].tolist()
    bend = before - 2.0 * top + after
    return index + (0.5 * (before - after) / bend if bend < 0.0 else 0.0)


def paid(places: float, gain: float, level: float) -> float:
    """Return the number of places for the penalty of a gain, if chance alone brings `level` times the expected gain.

    Coloured noise is stronger at some places; gain − 2·ln(places) then becomes the value relative to the noise level
    of the place itself.
    """
    return places * math.exp(min(0.5 * gain * (1.0 - 1.0 / max(level, 1.0)), 600.0))


def shortest_resolved(information: FloatArray, period: float) -> float:
    """Return the shortest period [bins], at least `period`, that the values of a coordinate resolve.

    `information` (b,) are the sums over its bins. A few constant rates have a few values of rate and output, which a
    wave of some shorter period always follows.
    """
    while period < information.size:
        cells = np.bincount((np.arange(information.size) * CELLS / period).astype(np.int64), information)
        separate = float(cells.sum()) ** 2 / max(float(cells @ cells), 1e-300)
        if separate >= min(_MANY, _FEWEST_A_PERIOD * information.size / period):
            break
        period *= _LONGER
    return period
