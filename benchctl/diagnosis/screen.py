"""Every hypothesis at once, each at a few places: how much it could explain, and how much chance alone would.

A probe's columns are what the prediction changes by, whitened, with everything that the model in hand can follow taken
off. By how much twice the log likelihood falls is then a matter of scalar products. On recordings in which nothing is
missing those products are normal with a covariance that is known, the columns' own: so the largest fall that chance
brings, over all probes of this very procedure and noise, is drawn a few thousand times without simulating a sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fit import Fit, inverse
from benchctl.diagnosis.noise import Whitener
from benchctl.diagnosis.probes import Probe
from benchctl.diagnosis.problem import Problem

FloatArray = npt.NDArray[np.float64]

_UNSEEN = 1e-7
"""Share of a column's own power that must be left when the model in hand has been taken off: below it is rounding."""

_DRAWS = 4000
_CHANCE = 0.001
"""How often chance may reach the threshold: one in a thousand, so that one in a hundred is kept when noise is odd."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A probe and what it promises: `gain` in twice the log likelihood, `weights` of its columns at the best.

    `power` (columns,) is the sum of squares of each column's part that is its own, over the noise's variance.
    """

    probe: Probe
    gain: float
    weights: FloatArray
    power: FloatArray
    columns: slice


@dataclass(frozen=True, kw_only=True)
class Screening:
    """The outcome: probes with their promise, the correlations of all columns (m, m), and the threshold of chance."""

    scored: tuple[Scored, ...]
    correlation: FloatArray
    threshold: float

    def best_of_each(self) -> list[Scored]:
        """The most promising probe of each effect, the most promising effect first."""
        best: dict[str, Scored] = {}
        for one in self.scored:
            if one.gain > best.get(one.probe.identifier, one).gain or one.probe.identifier not in best:
                best[one.probe.identifier] = one
        return sorted(best.values(), key=lambda one: -one.gain)


def screen(
    problem: Problem,
    whitener: Whitener,
    fitted: Fit,
    probes: Sequence[Probe],
    *,
    seed: int,
    progress: Callable[[str], None] = lambda _: None,
) -> Screening:
    """Score all probes against a fitted model, on the steps that it was fitted to."""
    rows = fitted.fitted[problem.step]
    known = fitted.derivatives * rows[:, None]
    covariance = fitted.inverse_information
    white = fitted.white * rows
    total = float(white @ white)
    count = max(float((whitener.weight[rows] > 0.0).sum()) - len(fitted.numbers), 1.0)
    variance = total / count
    columns: list[npt.NDArray[np.float32]] = []
    scored: list[Scored] = []
    for probe in probes:
        progress(probe.identifier)
        first, powers, group = len(columns), [], []
        for effect in probe.columns:
            changed = problem.predict(fitted.point.baseline, (*fitted.point.effects, effect)) - fitted.predicted
            if not np.isfinite(changed).all():
                changed = np.zeros_like(changed)
            column = whitener(changed)
            column *= rows
            before = float(column @ column)
            column -= known @ (covariance @ (known.T @ column))
            after = float(column @ column)
            if after <= _UNSEEN * before or before == 0.0:
                column = np.zeros_like(column)
                after = 0.0
            powers.append(after / variance)
            group.append(column)
            columns.append((column / (math.sqrt(after) or 1.0)).astype(np.float32))
        block = np.stack(group, axis=1)
        product = block.T @ white
        weights = inverse(block.T @ block) @ product
        drop = min(max(float(weights @ product), 0.0), total * (1 - 1e-12))
        scored.append(
            Scored(
                probe=probe,
                gain=-count * math.log1p(-drop / total),
                weights=weights,
                power=np.array(powers),
                columns=slice(first, len(columns)),
            )
        )
    matrix = np.stack(columns, axis=1) if columns else np.zeros((problem.measured.size, 0), np.float32)
    correlation = (matrix.T @ matrix).astype(np.float64)
    return Screening(
        scored=tuple(scored),
        correlation=correlation,
        threshold=_threshold(correlation, [one.columns for one in scored], seed),
    )


def _threshold(correlation: FloatArray, groups: Sequence[slice], seed: int) -> float:
    """The gain that chance reaches anywhere in the search, one time in a thousand."""
    if not groups:
        return 0.0
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(seed).standard_normal((_DRAWS, correlation.shape[0])) @ root.T
    largest = np.zeros(_DRAWS)
    for group in groups:
        part = draws[:, group]
        gain = np.einsum("di,ij,dj->d", part, inverse(correlation[group, group]), part)
        np.maximum(largest, gain, out=largest)
    return float(np.quantile(largest, 1.0 - _CHANCE))
