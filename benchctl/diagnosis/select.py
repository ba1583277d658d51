"""Selection: the effects that the data demand, added one by one, refitted together, and dropped where not needed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fit import Fit, Point, fit, inverse, products_of, whitened_columns
from benchctl.diagnosis.noise import Whitener
from benchctl.diagnosis.probes import probes_of
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.screen import Screening, screen
from instruments.physics.effects.effect import DescribedEffect

BoolArray = npt.NDArray[np.bool_]

_MOST_FINDINGS = 5
_TRIED = 8
_WALK_GAINS = (0.0, *np.geomspace(3e-5, 0.1, 14).tolist())
_HELD_OUT = 6
"""One step in so many of a kind chooses nothing and fits nothing."""


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What was chosen. `rivals` are, by finding, other effects in its place and by how much they are worse.

    `walk_gain_of_likelihood` is what a random walk of the bias explains, 0 where none is demanded.
    """

    before: Fit
    after: Fit
    whitener: Whitener
    screening: Screening
    rivals: dict[str, dict[str, float]]
    walk_gain_of_likelihood: float
    heldout: BoolArray


def held_out_steps(problem: Problem) -> BoolArray:
    """Whole steps, one in six of each kind, that play no part in choosing or fitting; mask of shape (m,)."""
    kinds = problem.step_kinds
    held = np.zeros(len(kinds), np.bool_)
    for kind in set(kinds):
        members = [i for i, one in enumerate(kinds) if one == kind]
        held[members[_HELD_OUT // 2 :: _HELD_OUT]] = True
    return held


def gain_of(better: Fit, worse: Fit, steps: BoolArray | None = None) -> float:
    """By how much twice the log likelihood is larger, on the fitted steps or on others."""
    chosen = better.fitted if steps is None else steps
    rows = float(better.products.rows[chosen].sum())
    good, bad = (max(float(one.products.squares[chosen].sum()), 1e-300) for one in (better, worse))
    return rows * math.log(bad / good)


def select(problem: Problem, *, seed: int, progress: Callable[[str, float], None]) -> Selection:
    """Find the effects that a problem's data demand."""
    held = held_out_steps(problem)
    search = _Search(problem, ~held, seed, progress)
    return search.run(held)


class _Search:
    def __init__(self, problem: Problem, fitted: BoolArray, seed: int, progress: Callable[[str, float], None]) -> None:
        self._problem, self._fitted, self._seed, self._progress = problem, fitted, seed, progress
        self._probes = [probe for kind in problem.effects.values() for probe in probes_of(problem, kind)]
        self._whitener = Whitener(
            stretches=problem.stretches,
            interval_s=problem.interval_s,
            weight=problem.usable.astype(np.float64),
        )

    def run(self, held: BoolArray) -> Selection:
        untouched = Point(baseline=self._problem.baseline_start)
        before = present = self._fit(untouched)
        rivals: dict[str, dict[str, float]] = {}
        walk = 0.0
        for number in range(_MOST_FINDINGS + 1):
            screening = screen(
                self._problem,
                self._whitener,
                present,
                self._probes,
                seed=self._seed,
                progress=partial(self._told, number / (_MOST_FINDINGS + 1)),
            )
            if number == _MOST_FINDINGS:
                break
            tried = self._tried(present, screening)
            gain, whitener = self._walk(present)
            best = max(tried, key=lambda one: gain_of(one, present), default=None)
            promise = 0.0 if best is None else gain_of(best, present)
            if whitener is not None and gain > max(promise, screening.threshold):
                walk, self._whitener = gain, whitener
                before, present = self._fit(untouched), self._fit(present.point)
                continue
            if best is None or promise <= screening.threshold or gain_of(best, present, held) <= 0.0:
                break
            name = best.point.effects[-1].identifier
            rivals[name] = {one.point.effects[-1].identifier: gain_of(best, one) for one in tried if one is not best}
            present = self._pruned(best, screening.threshold)
        return Selection(
            before=before,
            after=present,
            whitener=self._whitener,
            screening=screening,
            rivals=rivals,
            walk_gain_of_likelihood=walk,
            heldout=held,
        )

    def _told(self, share: float, name: str) -> None:
        self._progress(name, share)

    def _fit(self, point: Point) -> Fit:
        return fit(self._problem, self._whitener, point, self._fitted)

    def _tried(self, present: Fit, screening: Screening) -> list[Fit]:
        known = {effect.identifier for effect in present.point.effects}
        promising = [
            one
            for one in screening.best_of_each()
            if one.gain > screening.threshold and one.probe.identifier not in known
        ]
        tried = []
        for one in promising[:_TRIED]:
            start: DescribedEffect = one.probe.start(one.weights)
            tried.append(self._fit(replace(present.point, effects=(*present.point.effects, start))))
        return tried

    def _pruned(self, present: Fit, threshold: float) -> Fit:
        """Without the effects that are no longer needed."""
        for effect in present.point.effects[:-1]:
            rest = tuple(one for one in present.point.effects if one is not effect)
            less = self._fit(Point(baseline=present.point.baseline, effects=rest))
            if gain_of(present, less) < threshold:
                present = less
        return present

    def _walk(self, present: Fit) -> tuple[float, Whitener | None]:
        """What a wandering bias would explain beside the model in hand; None where it is in it, or none is seen."""
        if self._whitener.walk_gain > 0.0 or len(self._problem.stretches) > 1:
            return 0.0, None
        squares: list[float] = []
        candidates = [replace(self._whitener, walk_gain=gain) for gain in _WALK_GAINS]
        for whitener in candidates:
            white = whitener(present.residual)
            columns = whitened_columns(whitener, present.raw_derivatives)
            information, gradient, total, rows = products_of(self._problem, columns, white, whitener).of(self._fitted)
            squares.append(total - float(gradient @ inverse(information) @ gradient))
        best = int(np.argmin(squares))
        return rows * math.log(squares[0] / squares[best]), candidates[best] if best else None
