"""Screening of all hypotheses at a few places each: how much each could explain, and how much chance would.

A probe's columns are the whitened changes of the prediction, with the part that the present model can follow removed.
The decrease of twice the log likelihood then follows from scalar products. On recordings in which nothing is missing,
these products are normal with a known covariance, that of the columns. So the largest decrease by chance, over all
probes of this procedure and this noise, is drawn a few thousand times without simulating any samples.

If the noise is not as white as assumed, a product scatters more, and the gain is reduced by the same factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.keys import Place, place_of
from benchctl.diagnosis.search.probes import Probe
from benchctl.diagnosis.search.scatter import Scatter
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Fit, inverse
from benchctl.estimation.noise import Whitener
from benchctl.side_by_side import shared_out
from benchctl.signals.blocks import block_starts, consecutive, in_cache
from benchctl_instruments.arrays import BoolArray, FloatArray

SingleArray = npt.NDArray[np.float32]

_UNSEEN = 1e-7
"""Smallest share of a column's power that must remain after the present model is removed; less is rounding."""

_CHOICES, _NEARLY = 2, 0.05
_WORTH = 8.0
"""Smaller gains are not examined further."""

_BATCH, _BATCH_ROWS = 4, 32_000_000
"""Number of probes screened together, and the maximum number of rows of all of them."""
_ROWS_ENOUGH = 1_000_000

_DRAWS = 4000
_CHANCE = 0.001
"""Probability that chance reaches the threshold: 0.001, so that it stays below 0.01 with unusual noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A probe and its score: `gain` in twice the log likelihood, `weights` of its columns at the optimum.

    `scatter`, at least 1, is the ratio of the gain's chance variation to that expected from white noise. `power`
    (columns,) is the sum of squares of each column's part that the model cannot follow, over the noise variance. If
    that is zero although the effect changes the prediction, the effect is `followed` by the present model.
    """

    probe: Probe
    gain: float
    scatter: float
    weights: FloatArray
    power: FloatArray
    followed: bool = False

    @property
    def promise(self) -> float:
        """The gain less the expected contribution of chance."""
        return self.gain / self.scatter - 2.0 * math.log(self.probe.places)


@dataclass(frozen=True, kw_only=True)
class Screening:
    """The result of a screening: probes with their promise, and the threshold of chance."""

    scored: tuple[Scored, ...]
    threshold: float

    def best_of_each(self) -> list[Scored]:
        """Return the most promising probe of each effect, the most promising effect first.

        For an effect with choices, the best probe of another choice is included if its promise is comparable: only a
        fit can decide which choice is right.
        """
        best: dict[Place, Scored] = {}
        for one in self.scored:
            place = place_of(one.probe.columns[0])
            if place not in best or one.promise > best[place].promise:
                best[place] = one
        kept: dict[str, list[Scored]] = {}
        for one in sorted(best.values(), key=_place_in_order):
            same = kept.setdefault(one.probe.identifier, [])
            if not same or (len(same) < _CHOICES and one.promise > _NEARLY * same[0].promise):
                same.append(one)
        return sorted((one for same in kept.values() for one in same), key=_place_in_order)


def _place_in_order(one: Scored) -> float:
    """Sort key: most promising first; of two equal up to the last digits, the one that was tested first."""
    return -float(f"{one.promise:.6g}")


def screen(
    problem: PartProblem,
    whitener: Whitener,
    fitted: Fit,
    probes: Sequence[Probe],
    *,
    seed: int,
    threshold: float | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Screening:
    """Score all probes against a fitted model, on the steps that it was fitted to.

    The threshold of chance is drawn for these probes unless one is given.
    """
    base = _Beside.of(problem, whitener, fitted)
    drawn = threshold is None

    def looked_at(some: Sequence[Probe]) -> tuple[list[Scored], SingleArray | None]:
        columns = base.columns(problem, whitener, fitted, some, progress)
        products = base.products(columns)
        scored = base.scored(some, columns, products)
        return scored, base.directions(columns, products) if drawn else None

    scored: list[Scored] = []
    directions: list[SingleArray] = []
    for some, own in shared_out(looked_at, _in_batches(probes, base.white.size)):
        scored += some
        directions += [] if own is None else [own]
    if threshold is None:
        widths = [len(probe.columns) for probe in probes]
        threshold = _threshold(_correlation(directions), consecutive(widths), base.count, seed)
    return Screening(scored=tuple(scored), threshold=threshold)


def _in_batches(probes: Sequence[Probe], rows: int) -> list[Sequence[Probe]]:
    """Split the probes into batches that are screened together, so that the derivatives are read once per batch."""
    size = max(1, min(_BATCH, _BATCH_ROWS // max(rows, 1)))
    return [probes[first : first + size] for first in range(0, len(probes), size)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Products:
    """Products of whitened columns with the derivatives (k, p), with the residual (k,) and with each other (k, k).

    `own` (k,) is the sum of squares of each column's part that the model cannot follow, 0 if that is only rounding.
    """

    known: FloatArray
    white: FloatArray
    each_other: FloatArray
    own: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Beside:
    """The fit that probes are compared with: derivatives `known` (n, p) and residual `white` (n,), both whitened.

    Values compared in addition to the problem's rows (`spectral_residual`) follow as further rows. Columns, the
    residual and the noise's `weight` are 0 on rows of steps not used in the fit (`rows`), so that products with the
    derivatives include only the fitted rows. `covariance` (p, p) is that of the parameters for noise of deviation 1;
    `count` is the number of degrees of freedom.
    """

    white: FloatArray
    known: FloatArray
    covariance: FloatArray
    count: float
    rows: BoolArray
    weight: FloatArray

    @classmethod
    def of(cls, problem: PartProblem, whitener: Whitener, fitted: Fit) -> Self:
        rows = fitted.fitted[problem.step]
        spectral_rows, spectral = fitted.fitted[problem.spectral_step], fitted.spectral
        every = np.concatenate([rows, spectral_rows])
        none = not spectral_rows.size
        return cls(
            white=np.concatenate([fitted.white, spectral.residual]) * every,
            known=fitted.derivatives if none else np.vstack([fitted.derivatives, spectral.derivatives]),
            covariance=fitted.inverse_information,
            count=max(float((whitener.weight[rows] > 0.0).sum()) - len(fitted.numbers), 1.0),
            rows=every,
            weight=whitener.weight * rows,
        )

    @cached_property
    def total(self) -> float:
        """The sum of squares of the residual."""
        return float(self.white @ self.white)

    def columns(
        self,
        problem: PartProblem,
        whitener: Whitener,
        fitted: Fit,
        probes: Sequence[Probe],
        progress: Callable[[str], None],
    ) -> FloatArray:
        """Return the whitened change of the prediction by each probe's effects, one row per effect, shape (k, n)."""
        changed = np.empty((sum(len(probe.columns) for probe in probes), self.white.size))
        filled = iter(changed)
        count = fitted.predicted.size
        for probe in probes:
            progress(probe.identifier)
            for effect, column in zip(probe.columns, filled, strict=False):
                effects = (*fitted.point.effects, effect)
                predicted = problem.predict(fitted.point.baseline, effects)
                residual = problem.spectral_residual(fitted.point.baseline, effects)
                column[count:] = (fitted.spectral.residual - residual) * self.rows[count:]
                self._fill(column[:count], predicted, fitted.predicted, None if whitener.slow else self.weight)
        if whitener.slow:
            changed[:, :count] = whitener(changed[:, :count])
            changed[:, :count] *= self.rows[:count]
        return changed

    def _fill(self, column: FloatArray, predicted: FloatArray, known: FloatArray, weight: FloatArray | None) -> None:
        """Fill the column (n,) with the weighted prediction less the known one; with 0 if any value is not finite."""
        for rows in in_cache(slice(0, known.size)):
            part = np.subtract(predicted[rows], known[rows], out=column[rows])
            if not np.isfinite(part).all():
                column[:] = 0.0
                return
            if weight is not None:
                part *= weight[rows]

    def products(self, columns: FloatArray) -> _Products:
        """Return the products of columns (k, n), computed in blocks of rows that fit into a core's cache."""
        many = len(columns)
        known, white, each_other = np.zeros((many, self.known.shape[1])), np.zeros(many), np.zeros((many, many))
        for rows in self._in_cache():
            some = columns[:, rows]
            known += some @ self.known[rows]
            white += some @ self.white[rows]
            each_other += some @ some.T
        power = np.diag(each_other)
        own = power - np.einsum("ki,ij,kj->k", known, self.covariance, known)
        return _Products(known=known, white=white, each_other=each_other, own=np.where(own > _UNSEEN * power, own, 0.0))

    def scored(self, probes: Sequence[Probe], columns: FloatArray, products: _Products) -> list[Scored]:
        """Return the scores of the probes, whose columns are (k, n)."""
        scored = []
        for probe, some in zip(probes, consecutive([len(probe.columns) for probe in probes]), strict=True):
            own, crossed, each_other = products.own[some], products.known[some], products.each_other[some, some]
            visible = own > 0.0
            of_known = self.covariance @ crossed.T
            gram = (each_other - crossed @ of_known) * np.outer(visible, visible)
            product = (products.white[some] - self._gradient @ of_known) * visible
            weights = inverse(gram) @ product
            if not probe.sizes:  # the amount of this effect cannot be negative
                weights = np.maximum(weights, 0.0)
            drop = min(max(float(weights @ product), 0.0), self.total * (1 - 1e-12))
            gain = -self.count * math.log1p(-drop / self.total)
            odd = 1.0
            if gain > _WORTH:
                odd = self._scatter(columns[some], weights, of_known @ weights)
            scored.append(
                Scored(
                    probe=probe,
                    gain=gain,
                    scatter=odd,
                    weights=weights,
                    power=own * self.count / self.total,
                    followed=bool(each_other.any()) and not visible.any(),
                )
            )
        return scored

    def directions(self, columns: FloatArray, products: _Products) -> SingleArray:
        """Return the part of columns (k, n) that the model cannot follow, in single precision; 0 if there is none.

        For very many rows a subset is used: it determines the correlation of the columns well enough.
        """
        own = columns[:, self._enough] - (products.known @ self.covariance) @ self._enough_known
        own *= (products.own > 0.0)[:, None]
        return np.asarray(own, np.float32)

    def _scatter(self, columns: FloatArray, weights: FloatArray, of_known: FloatArray) -> float:
        """Return the scatter of what columns (k, n) explain with weights (k,), less what the model can follow (p,)."""
        found = Scatter()
        for rows in self._in_cache():
            explained = weights @ columns[:, rows] - (self.known[rows] @ of_known) * self.rows[rows]
            found.add(explained, self.white[rows], block_starts(explained.size))
        return found.ratio

    def _in_cache(self) -> Iterator[slice]:
        return in_cache(slice(0, self.white.size))

    @property
    def _enough(self) -> slice:
        return slice(None, None, self.white.size // _ROWS_ENOUGH + 1)

    @cached_property
    def _enough_known(self) -> FloatArray:
        return np.ascontiguousarray(self.known[self._enough].T) * self.rows[self._enough]

    @cached_property
    def _gradient(self) -> FloatArray:
        return self.known.T @ self.white


def _correlation(directions: Sequence[SingleArray]) -> FloatArray:
    """Return the correlation of columns (k, n), which are given in groups."""
    columns = np.concatenate(directions) if directions else np.zeros((0, 0), np.float32)
    products = (columns @ columns.T).astype(np.float64)
    size = np.sqrt(np.diag(products))
    scale = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    return np.asarray(products * np.outer(scale, scale))


def _threshold(correlation: FloatArray, groups: Sequence[slice], count: float, seed: int) -> float:
    """Return the gain that chance reaches anywhere in the search with probability 0.001, for `count` rows."""
    if not groups:
        return 0.0
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    chance = np.random.default_rng(seed)
    draws = chance.standard_normal((_DRAWS, correlation.shape[0])) @ root.T
    largest = np.zeros(_DRAWS)
    for group in groups:
        part = draws[:, group]
        gain = np.einsum("di,ij,dj->d", part, inverse(correlation[group, group]), part)
        np.maximum(largest, gain, out=largest)
    # the noise level is estimated from the same rows: with few rows chance explains a larger share
    gains = count * np.log1p(largest / chance.chisquare(count, _DRAWS))
    return float(np.quantile(gains, 1.0 - _CHANCE))
