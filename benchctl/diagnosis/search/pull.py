"""What a fit's residual says of any change of the prediction, row by row: a scan then looks at no filter again.

With the residual r and the noise's whitening W, twice the log likelihood gains (p·c)²/(c·i·c) from a column c in the
prediction, where p = Wᵀ·W·r/σ² is the pull of the rows, and i, their information, is weight²/σ² where W is a filter
that passes c as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchctl.estimation.fit import Fit
from benchctl.estimation.noise import Whitener
from benchctl.estimation.problem import Problem
from benchctl_instruments.arrays import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Pull:
    """`rows` (n,) are those of the fitted steps that count; `pull` and `information` (n,) are 0 elsewhere."""

    whitener: Whitener
    fitted: Fit
    rows: BoolArray
    pull: FloatArray
    information: FloatArray

    def of_known(self, index: int) -> FloatArray:
        """The pull that the derivative by the fit's free number `index` would have as a residual, shape (n,)."""
        pulled = _back(self.whitener, self.fitted.derivatives[:, index] * self.rows)
        pulled /= self.fitted.deviation
        return pulled


@dataclass(frozen=True, slots=True)
class Place:
    """A value of a shape parameter at which the residual pulls, what it promises there, and out of how many it is."""

    value: float
    gain: float
    places: float


def pull_of(problem: Problem, whitener: Whitener, fitted: Fit) -> Pull:
    """The pull of a fit's residual, over the steps to which it was fitted."""
    rows = fitted.fitted[problem.step] & (whitener.weight > 0.0)
    return Pull(
        whitener=whitener,
        fitted=fitted,
        rows=rows,
        pull=np.where(rows, _back(whitener, np.where(rows, fitted.white, 0.0)), 0.0) / fitted.deviation**2,
        information=np.where(rows, (whitener.weight / fitted.deviation) ** 2, 0.0),
    )


def unweighted(whitener: Whitener, values: FloatArray) -> FloatArray:
    """The whitening filter alone, over rows without gaps, shape (n,)."""
    plain = replace(whitener, weight=np.ones_like(values), time_s=np.zeros(0))
    return plain(values)


def _back(whitener: Whitener, values: FloatArray) -> FloatArray:
    """The whitening's transpose: the same filter, run from the end to the beginning."""
    return unweighted(whitener, (values * whitener.weight)[::-1])[::-1]


def peaks(gain: FloatArray, count: int, apart: int) -> list[int]:
    """Indices of the largest values of (m,), the largest first, none nearer than `apart` to a larger one."""
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
    """Where, in indices, the parabola through a peak and its neighbours has its top."""
    if not 0 < index < gain.size - 1:
        return float(index)
    before, top, after = gain[index - 1 : index + 2].tolist()
    bend = before - 2.0 * top + after
    return index + (0.5 * (before - after) / bend if bend < 0.0 else 0.0)


def paid(places: float, gain: float, level: float) -> float:
    """How many places a gain must be paid for as the best of, where chance alone brings `level` times what it should.

    Noise that is not quite white has places at which it is louder; gain − 2·ln(places) is then what it would be there
    by the noise of the place itself.
    """
    return places * math.exp(min(0.5 * gain * (1.0 - 1.0 / max(level, 1.0)), 600.0))
