"""An effect put into a recording, to see whether the score that decides finds it again.

What it changes in the prediction is added to what was measured, with everything that the recording holds besides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self, cast

from benchctl.diagnosis.search.held_out import dealt, gain_on, least_gain
from benchctl.diagnosis.search.pairs import own_columns
from benchctl.diagnosis.search.probes import Probe
from benchctl.diagnosis.search.scatter import scatter
from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.fit import fit, gain_kept, inverse
from benchctl.estimation.point import at_bound
from benchctl.estimation.problem import Problem
from benchctl.signals.blocks import block_starts, step_starts
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect

_ROUNDS = 3
"""Of a fit that begins beside the truth."""
_FEW_ROWS = 20_000
"""Of more rows the change is scored and not fitted: a fit of every effect would take longer than the diagnosis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Injection:
    """A probe beside what was chosen; `columns` (k, n) are its own, whitened."""

    problem: Problem
    chosen: Selection
    probe: Probe
    columns: FloatArray

    @classmethod
    def of(cls, problem: Problem, chosen: Selection, probe: Probe) -> Self:
        """The probe's columns beside the model that was chosen."""
        columns = own_columns(problem, chosen.whitener, chosen.after, probe.columns)
        return cls(problem=problem, chosen=chosen, probe=probe, columns=columns)

    def found_again(self, effect: DescribedEffect) -> bool:
        """Whether the probe finds an effect that was put into the recording.

        It must pass as a finding does: beyond chance, in all steps alike, on steps that were left out; where there are
        few rows also as fitted, within its range.
        """
        after, step = self.chosen.after, self.problem.step
        added = own_columns(self.problem, self.chosen.whitener, after, [effect])[0]
        rows, white = after.fitted[step], after.white + added
        columns = self.columns * rows
        weights = inverse(columns @ columns.T) @ (columns @ white)
        left = white - weights @ self.columns
        return self._passes(left, white) and (step.size > _FEW_ROWS or self._fitted(effect, weights))

    def _passes(self, better: FloatArray, worse: FloatArray) -> bool:
        """Whether the gain of a whitened residual over another passes though it scatters, and held-out steps agree."""
        step = self.problem.step
        rows, held = self.chosen.after.fitted[step], self.chosen.heldout[step]
        explained, white = (worse - better) * rows, worse * rows
        by = max(scatter(explained, white, starts) for starts in (block_starts(step.size), step_starts(step)))
        gain = gain_on(better[rows], worse[rows]) / by - 2.0 * math.log(self.probe.places)
        return gain > self.chosen.least and gain_on(better[held], worse[held]) >= least_gain(better[held], worse[held])

    def _fitted(self, effect: DescribedEffect, weights: FloatArray) -> bool:
        """The same of a fit to the recording with the effect in it."""
        chosen, after = self.chosen, self.chosen.after
        added = self.problem.predict(after.point.baseline, (*after.point.effects, effect)) - after.predicted
        there = cast(Problem, _Injected(self.problem, self.problem.measured + added))
        less = fit(there, chosen.whitener, after, after.fitted, rounds=_ROUNDS)
        start = replace(less.point, effects=(*less.point.effects, self.probe.start(weights)))
        found = fit(there, chosen.whitener, start, after.fitted)
        return (
            self._passes(found.white, less.white)
            and gain_kept(found, less, dealt(self.problem)) > 0.0
            and not at_bound(found.point.effects[-1])
        )


class _Injected:
    """A problem of which something else was measured."""

    def __init__(self, problem: Problem, measured: FloatArray) -> None:
        self._problem = problem
        self.measured = measured

    def __getattr__(self, name: str) -> Any:
        return getattr(self._problem, name)
