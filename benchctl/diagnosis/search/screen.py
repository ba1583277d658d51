"""Every hypothesis at once, each at a few places: how much it could explain, and how much chance alone would.

A probe's columns are what the prediction changes by, whitened, with everything that the model in hand can follow taken
off. By how much twice the log likelihood falls is then a matter of scalar products. On recordings in which nothing is
missing those products are normal with a covariance that is known, the columns' own: so the largest fall that chance
brings, over all probes of this very procedure and noise, is drawn a few thousand times without simulating a sample.

Where noise is not as white as it is taken for (the encoder's own, through the filter of the rate), a product scatters
more than that: by how much is read off its parts, summed over half a second each (White, Econometrica 48, 1980; Newey &
West, Econometrica 55, 1987), and the gain counts for so much less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fitting.fit import Fit, inverse
from benchctl.diagnosis.fitting.noise import Whitener
from benchctl.diagnosis.keys import Place, place_of
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.search.probes import Probe
from benchctl.diagnosis.signals.blocks import block_starts

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_UNSEEN = 1e-7
"""Share of a column's own power that must be left when the model in hand has been taken off: below it is rounding."""

_CHOICES, _NEARLY = 2, 0.05
_WORTH = 8.0
"""Gains below it are not looked at twice."""

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
    columns: slice
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
        for one in sorted(best.values(), key=lambda one: -one.promise):
            same = kept.setdefault(one.probe.identifier, [])
            if not same or (len(same) < _CHOICES and one.promise > _NEARLY * same[0].promise):
                same.append(one)
        return sorted((one for same in kept.values() for one in same), key=lambda one: -one.promise)


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
    rows = fitted.fitted[problem.step]
    known = fitted.derivatives * rows[:, None]
    covariance = fitted.inverse_information
    white = fitted.white * rows
    total = float(white @ white)
    count = max(float((whitener.weight[rows] > 0.0).sum()) - len(fitted.numbers), 1.0)
    variance = total / count
    counted = np.flatnonzero(rows & (whitener.weight > 0.0))
    drawn = threshold is None
    columns = np.zeros((sum(len(probe.columns) for probe in probes), counted.size if drawn else 0), np.float32)
    filled = 0
    scored: list[Scored] = []
    for probe in probes:
        progress(probe.identifier)
        first, powers, group, shows = filled, [], [], False
        for effect in probe.columns:
            changed = problem.predict(fitted.point.baseline, (*fitted.point.effects, effect)) - fitted.predicted
            if not np.isfinite(changed).all():
                changed = np.zeros_like(changed)
            column = whitener(changed)
            column *= rows
            before = float(column @ column)
            shows = shows or before > 0.0
            column -= known @ (covariance @ (known.T @ column))
            after = float(column @ column)
            if after <= _UNSEEN * before or before == 0.0:
                column = np.zeros_like(column)
                after = 0.0
            powers.append(after / variance)
            group.append(column)
            if drawn:
                columns[filled] = column[counted] / (math.sqrt(after) or 1.0)
            filled += 1
        block = np.stack(group, axis=1)
        product = block.T @ white
        weights = inverse(block.T @ block) @ product
        if not probe.sizes:  # there is no such thing as less than nothing of it
            weights = np.maximum(weights, 0.0)
        drop = min(max(float(weights @ product), 0.0), total * (1 - 1e-12))
        gain = -count * math.log1p(-drop / total)
        scored.append(
            Scored(
                probe=probe,
                gain=gain,
                scatter=scatter(block @ weights, white, block_starts(white.size)) if gain > _WORTH else 1.0,
                weights=weights,
                power=np.array(powers),
                columns=slice(first, filled),
                followed=shows and not any(powers),
            )
        )
    if threshold is None:
        correlation = (columns @ columns.T).astype(np.float64)
        threshold = _threshold(correlation, [one.columns for one in scored], count, seed)
    return Screening(scored=tuple(scored), threshold=threshold)


def scatter(explained: FloatArray, white: FloatArray, starts: IntArray) -> float:
    """By how much a gain varies more than white noise lets it, at least 1.

    `explained` (n,) is what is taken off the residual `white` (n,), `starts` the first rows of the parts that noise
    does not reach across; rows that do not count are zero in the first two.
    """
    column, rest = explained, white - explained
    sums = np.add.reduceat(column * rest, starts)
    variance = float(rest @ rest) / max(int(np.count_nonzero(rest)), 1)
    usual = variance * float(column @ column)
    return max(float(sums @ sums) / usual, 1.0) if usual > 0.0 else 1.0


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
