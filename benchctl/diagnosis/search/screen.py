"""Every hypothesis at once, each at a few places: how much it could explain, and how much chance alone would.

A probe's columns are what the prediction changes by, whitened, with everything that the model in hand can follow taken
off. By how much twice the log likelihood falls is then a matter of scalar products. On recordings in which nothing is
missing those products are normal with a covariance that is known, the columns' own: so the largest fall that chance
brings, over all probes of this very procedure and noise, is drawn a few thousand times without simulating a sample.

Where noise is not as white as it is taken for, a product scatters more than that, and the gain counts for so much less.
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
from benchctl.estimation.fit import Fit, inverse
from benchctl.estimation.noise import Whitener
from benchctl.estimation.problem import Problem
from benchctl.side_by_side import shared_out
from benchctl.signals.blocks import block_starts, consecutive, in_cache
from benchctl_instruments.arrays import BoolArray, FloatArray

SingleArray = npt.NDArray[np.float32]

_UNSEEN = 1e-7
"""Share of a column's own power that must be left when the model in hand has been taken off: below it is rounding."""

_CHOICES, _NEARLY = 2, 0.05
_WORTH = 8.0
"""Gains below it are not looked at twice."""

_BATCH, _BATCH_ROWS = 4, 32_000_000
"""So many probes are looked at together, or as many as have so many rows between them."""
_ROWS_ENOUGH = 1_000_000

_DRAWS = 4000
_CHANCE = 0.001
"""How often chance may reach the threshold: one in a thousand, so that one in a hundred is kept when noise is odd."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A probe and what it promises: `gain` in twice the log likelihood, `weights` of its columns at the best.

    `scatter`, at least 1, is by how much the gain varies more by chance than white noise lets it. `power` (columns,) is
    the sum of squares of each column's part that is its own, over the noise's variance; where that is nothing although
    the effect shows, it is `followed` by what is in the model already.
    """

    probe: Probe
    gain: float
    scatter: float
    weights: FloatArray
    power: FloatArray
    followed: bool = False

    @property
    def promise(self) -> float:
        """The gain less what chance adds to it."""
        return self.gain / self.scatter - 2.0 * math.log(self.probe.places)


@dataclass(frozen=True, kw_only=True)
class Screening:
    """The outcome: probes with their promise, and the threshold of chance."""

    scored: tuple[Scored, ...]
    threshold: float

    def best_of_each(self) -> list[Scored]:
        """The most promising probe of each effect, the most promising effect first.

        Of an effect with choices the best of another choice follows where it promises anything like as much: which is
        right only a fit can tell.
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
    """The most promising first; of two that are alike but for the last digits, the one that was tried first."""
    return -float(f"{one.promise:.6g}")


def screen(
    problem: Problem,
    whitener: Whitener,
    fitted: Fit,
    probes: Sequence[Probe],
    *,
    seed: int,
    threshold: float | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Screening:
    """Score all probes against a fitted model, on the steps that it was fitted to.

    The threshold of chance is drawn for these probes, but where one is given.
    """
    beside = _Beside.of(problem, whitener, fitted)
    drawn = threshold is None

    def looked_at(some: Sequence[Probe]) -> tuple[list[Scored], SingleArray | None]:
        columns = beside.columns(problem, whitener, fitted, some, progress)
        products = beside.products(columns)
        scored = beside.scored(some, columns, products)
        return scored, beside.directions(columns, products) if drawn else None

    scored: list[Scored] = []
    directions: list[SingleArray] = []
    for some, own in shared_out(looked_at, _in_batches(probes, beside.white.size)):
        scored += some
        directions += [] if own is None else [own]
    if threshold is None:
        widths = [len(probe.columns) for probe in probes]
        threshold = _threshold(_correlation(directions), consecutive(widths), beside.count, seed)
    return Screening(scored=tuple(scored), threshold=threshold)


def _in_batches(probes: Sequence[Probe], rows: int) -> list[Sequence[Probe]]:
    """Probes of which all columns, of so many rows, are looked at together: the fit's derivatives are read but once."""
    size = max(1, min(_BATCH, _BATCH_ROWS // max(rows, 1)))
    return [probes[first : first + size] for first in range(0, len(probes), size)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Products:
    """Products of whitened columns with what is known (k, p), with the residual (k,) and with each other (k, k).

    `own` (k,) is the sum of squares of each column's part that is its own, 0 where that is nothing.
    """

    known: FloatArray
    white: FloatArray
    each_other: FloatArray
    own: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Beside:
    """The fit that probes are held against: derivatives `known` (n, p) and residual `white` (n,), both whitened.

    What is compared beside the problem's rows (`spectral_residual`) comes behind them, as if it were more of them.
    Columns, the residual and the noise's `weight` are 0 on rows of steps that it was not fitted to (`rows`), so that
    their products with the derivatives are those of the others. `covariance` (p, p) is that of its numbers for noise of
    one; `count` is how many rows are free.
    """

    white: FloatArray
    known: FloatArray
    covariance: FloatArray
    count: float
    rows: BoolArray
    weight: FloatArray

    @classmethod
    def of(cls, problem: Problem, whitener: Whitener, fitted: Fit) -> Self:
        rows = fitted.fitted[problem.step]
        beside, spectral = fitted.fitted[problem.spectral_step], fitted.spectral
        every = np.concatenate([rows, beside])
        none = not beside.size
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
        """The residual's sum of squares."""
        return float(self.white @ self.white)

    def columns(
        self,
        problem: Problem,
        whitener: Whitener,
        fitted: Fit,
        probes: Sequence[Probe],
        progress: Callable[[str], None],
    ) -> FloatArray:
        """What the probes' effects change in the prediction, whitened, one row an effect, shape (k, n)."""
        changed = np.empty((sum(len(probe.columns) for probe in probes), self.white.size))
        filled = iter(changed)
        count = fitted.predicted.size
        for probe in probes:
            progress(probe.identifier)
            for effect, column in zip(probe.columns, filled, strict=False):
                effects = (*fitted.point.effects, effect)
                predicted = problem.predict(fitted.point.baseline, effects)
                beside = problem.spectral_residual(fitted.point.baseline, effects)
                column[count:] = (fitted.spectral.residual - beside) * self.rows[count:]
                self._fill(column[:count], predicted, fitted.predicted, None if whitener.slow else self.weight)
        if whitener.slow:
            changed[:, :count] = whitener(changed[:, :count])
            changed[:, :count] *= self.rows[:count]
        return changed

    def _fill(self, column: FloatArray, predicted: FloatArray, known: FloatArray, weight: FloatArray | None) -> None:
        """The column (n,) of what is predicted beyond what is known, weighed; 0 where it is not a number somewhere."""
        for rows in in_cache(slice(0, known.size)):
            part = np.subtract(predicted[rows], known[rows], out=column[rows])
            if not np.isfinite(part).all():
                column[:] = 0.0
                return
            if weight is not None:
                part *= weight[rows]

    def products(self, columns: FloatArray) -> _Products:
        """The products of columns (k, n): some rows at a time, so that all three find them in a core's own memory."""
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
        """What each of the probes promises, whose columns are (k, n)."""
        scored = []
        for probe, some in zip(probes, consecutive([len(probe.columns) for probe in probes]), strict=True):
            own, crossed, each_other = products.own[some], products.known[some], products.each_other[some, some]
            seen = own > 0.0
            of_known = self.covariance @ crossed.T
            gram = (each_other - crossed @ of_known) * np.outer(seen, seen)
            product = (products.white[some] - self._gradient @ of_known) * seen
            weights = inverse(gram) @ product
            if not probe.sizes:  # there is no such thing as less than nothing of it
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
                    followed=bool(each_other.any()) and not seen.any(),
                )
            )
        return scored

    def directions(self, columns: FloatArray, products: _Products) -> SingleArray:
        """What of columns (k, n) is their own, in single precision; of those that are not seen nothing.

        Of very many rows some are taken: how alike two columns are is known well enough from them.
        """
        own = columns[:, self._enough] - (products.known @ self.covariance) @ self._enough_known
        own *= (products.own > 0.0)[:, None]
        return np.asarray(own, np.float32)

    def _scatter(self, columns: FloatArray, weights: FloatArray, of_known: FloatArray) -> float:
        """That of what columns (k, n) explain with weights (k,), less what of it the model can follow (p,)."""
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
    """How alike columns (k, n) are, one group after another."""
    columns = np.concatenate(directions) if directions else np.zeros((0, 0), np.float32)
    products = (columns @ columns.T).astype(np.float64)
    size = np.sqrt(np.diag(products))
    scale = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    return np.asarray(products * np.outer(scale, scale))


def _threshold(correlation: FloatArray, groups: Sequence[slice], count: float, seed: int) -> float:
    """The gain that chance reaches anywhere in the search, one time in a thousand, on so many rows that count."""
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
    # the size of the noise is not known but measured on the same rows: of few, chance explains a larger share
    gains = count * np.log1p(largest / chance.chisquare(count, _DRAWS))
    return float(np.quantile(gains, 1.0 - _CHANCE))
