"""Scan over all limits of the range: a rate at which the output folds or overloads, and the largest output.

The effect of a limit between two rates of a procedure depends on its exact position: a few starting places would miss
it or match another one, and a fit that starts beyond the largest output does not return. Each effect acts along one
coordinate only, rate or output, so the residual's pull is summed over bins of it, and all places are scored from these
sums.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from benchctl.diagnosis.search.pull import Place, Pull, peaks
from benchctl.signals.binning import bin_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.fringe_ambiguity import folded_dps

_BINS = 2000
_PLACES = 400
_LOWEST = 0.05
"""Lowest place scanned, as a share of the fastest rate or the largest output."""
_APART = 8
_UNSURE = 3.0
"""Maximum factor by which the scale factor of a model fitted without the fold may be wrong."""


def fold_places(pull: Pull, rate_dps: FloatArray, scale_v_per_dps: float, count: int) -> list[Place]:
    """Return the most promising folds [deg/s] for rates of shape (n,), the most promising first."""

    def change(rates: FloatArray, fold: float) -> FloatArray:
        return scale_v_per_dps * (folded_dps(rates, fold) - rates)

    return _places(pull, rate_dps, change, count)


def limit_places(pull: Pull, output_v: FloatArray, count: int) -> list[Place]:
    """Return the most promising limits [V] of predicted outputs of shape (n,), the most promising first."""

    def change(outputs: FloatArray, limit: float) -> FloatArray:
        return np.clip(outputs, -limit, limit) - outputs

    return _places(pull, output_v, change, count)


def onset_places(pull: Pull, rate_dps: FloatArray, output_v: FloatArray, count: int) -> list[Place]:
    """Return the most promising onsets [deg/s] of an overload, for rates and predicted outputs of shape (n,)."""
    falling = np.sign(np.dot(rate_dps[pull.rows], output_v[pull.rows] - output_v[pull.rows].mean()))

    def change(rates: FloatArray, onset: float) -> FloatArray:
        return np.asarray(-falling * np.sign(rates) * np.maximum(np.abs(rates) - onset, 0.0))

    return _places(pull, rate_dps, change, count, sized=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class RailsPlace:
    """A proposed pair of rails [V], its promised gain, and the number of pairs it was selected from."""

    lower_v: float
    upper_v: float
    gain: float
    places: float


def rail_places(pull: Pull, output_v: FloatArray, count: int) -> list[RailsPlace]:
    """Return the most promising pairs of rails for predicted outputs of shape (n,), the most promising first.

    One rail of a pair may be at the end of the output range, where it has no effect.
    """
    low, high = float(output_v[pull.rows].min()), float(output_v[pull.rows].max())
    if not low < high:
        return []
    along = _Along.of(pull, output_v, np.linspace(low, high, _BINS + 1))
    inwards = np.linspace(0.0, (1.0 - _LOWEST) * (high - low), _PLACES)
    lowers, uppers = low + inwards, high - inwards
    # the effects of two rails add up, as no output is at both
    below = along.terms(np.maximum(along.middle, lowers[:, None]) - along.middle)
    above = along.terms(np.minimum(along.middle, uppers[:, None]) - along.middle)
    common = 2.0 * below.known @ along.covariance @ above.known.T
    gain = _gains(
        below.score[:, None] + above.score, np.maximum(below.own[:, None] + above.own - common, 1e-300), sized=False
    )
    gain[lowers[:, None] >= uppers] = 0.0
    found: list[RailsPlace] = []
    while len(found) < count:
        i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if not gain[i, j] > 0.0:
            break
        found.append(
            RailsPlace(
                lower_v=float(lowers[i]), upper_v=float(uppers[j]), gain=float(gain[i, j]), places=float(gain.size)
            )
        )
        gain[max(i - _APART, 0) : i + _APART + 1, max(j - _APART, 0) : j + _APART + 1] = 0.0
    return found


def _places(
    pull: Pull,
    coordinate: FloatArray,
    change: Callable[[FloatArray, float], FloatArray],
    count: int,
    *,
    sized: bool = False,
) -> list[Place]:
    """Return the most promising limits of a coordinate (n,); `change` is a limit's effect at values of it."""
    largest = float(np.abs(coordinate[pull.rows]).max())
    if largest <= 0.0:
        return []
    along = _Along.of(pull, coordinate, np.linspace(-largest, largest, _BINS + 1))
    ends = largest * np.linspace(_LOWEST, 1.0, _PLACES, endpoint=False)
    gain = along.gains(np.stack([change(along.middle, end) for end in ends.tolist()]), sized=sized)
    return [Place(float(ends[i]), float(gain[i]), float(_PLACES)) for i in peaks(gain, count, _APART)]


@dataclass(frozen=True, kw_only=True)
class _Along:
    """The pull of a residual summed over bins of a coordinate, with bin centres `middle` (b,).

    `pull` and `information` (b,) are sums over rows, `known` (b, p) sums of the pull of the fit's derivatives.
    """

    middle: FloatArray
    pull: FloatArray
    information: FloatArray
    known: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, pull: Pull, coordinate: FloatArray, edges: FloatArray) -> Self:
        """Sum over values of a coordinate (n,), in bins between edges (b + 1,)."""
        bins = bin_of(coordinate, edges)

        def summed(values: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(bins, values, minlength=edges.size - 1))

        return cls(
            middle=0.5 * (edges[:-1] + edges[1:]),
            pull=summed(pull.pull),
            information=summed(pull.information),
            known=np.stack([summed(pull.of_known(i)) for i in range(len(pull.fitted.numbers))], axis=1),
            covariance=pull.fitted.inverse_information,
        )

    def terms(self, changes: FloatArray) -> _Terms:
        """Return the products of changes of the prediction (m, b)."""
        known = changes @ self.known
        power = changes**2 @ self.information
        return _Terms(
            score=changes @ self.pull,
            known=known,
            own=power - np.einsum("fi,ij,fj->f", known, self.covariance, known),
        )

    def gains(self, changes: FloatArray, *, sized: bool) -> FloatArray:
        """Return the gains, (m,), of changes of the prediction (m, b), with optimal size above 0 if `sized`."""
        terms = self.terms(changes)
        return _gains(terms.score, np.maximum(terms.own, 1e-300), sized=sized)


@dataclass(frozen=True, kw_only=True)
class _Terms:
    """Products of changes with the residual's pull (m,) and with the derivatives (m, p), and the power not followed."""

    score: FloatArray
    known: FloatArray
    own: FloatArray


def _gains(score: FloatArray, own: FloatArray, *, sized: bool) -> FloatArray:
    share = np.maximum(score / own, 0.0) if sized else np.clip(score / own, 1.0 / _UNSURE, _UNSURE)
    return np.asarray(np.maximum(share * (2.0 * score - share * own), 0.0))
