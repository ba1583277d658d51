"""Pairs of effects of which neither is significant alone, because the residual of each contains the other.

Dry friction and a torque offset, for example, explain a bench together; either alone leaves so much of the other that
its gain does not exceed the scatter of such a residual. The promise of a pair is that of all its columns together, and
its scatter that of the residual of both.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.diagnosis.search.scatter import scatter
from benchctl.diagnosis.search.screen import Scored
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Fit, inverse
from benchctl.estimation.noise import Whitener
from benchctl.signals.blocks import block_starts
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two effects with starting values for a fit of both, and their joint promise in twice the log likelihood.

    `explains` is the share of the residual's power that they explain.
    """

    effects: tuple[DescribedEffect, DescribedEffect]
    places: float
    promise: float
    explains: float


def pairs_of(problem: PartProblem, whitener: Whitener, fitted: Fit, scored: Sequence[Scored]) -> list[Pair]:
    """Return all pairs of effects of different kinds for a fitted model, the most promising first."""
    rows = fitted.fitted[problem.step]
    white = fitted.white * rows
    total = float(white @ white)
    own = [own_columns(problem, whitener, fitted, one.probe.columns) * rows for one in scored]
    pairs = []
    for (first, its), (second, others) in itertools.combinations(zip(scored, own, strict=True), 2):
        if first.probe.identifier == second.probe.identifier:
            continue
        columns = np.concatenate([its, others])
        weights = inverse(columns @ columns.T) @ (columns @ white)
        explained = weights @ columns
        drop = min(max(float(explained @ white), 0.0), total * (1.0 - 1e-12))
        gain = -fitted.rows * math.log1p(-drop / total)
        places = first.probe.places * second.probe.places
        pairs.append(
            Pair(
                effects=(first.probe.start(weights[: len(its)]), second.probe.start(weights[len(its) :])),
                places=places,
                promise=gain / scatter(explained, white, block_starts(white.size)) - 2.0 * math.log(places),
                explains=drop / total,
            )
        )
    return sorted(pairs, key=lambda one: -float(f"{one.promise:.6g}"))


def own_columns(
    problem: PartProblem, whitener: Whitener, fitted: Fit, effects: Iterable[DescribedEffect]
) -> FloatArray:
    """Return the whitened change of the prediction by each effect, less what the model can follow, shape (k, n)."""
    point = fitted.point
    changed = [problem.predict(point.baseline, (*point.effects, one)) - fitted.predicted for one in effects]
    return fitted.beyond(np.stack([whitener(one) for one in changed]), problem.step)
