"""Injection test: add an effect to a recording and check whether the decision criteria detect it.

The effect's change of the prediction is added to the measured values; everything else in the recording stays.
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
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import fit, gain_kept, inverse
from benchctl.estimation.point import at_bound
from benchctl.signals.blocks import block_starts, step_starts
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect

_ROUNDS = 3
"""Rounds of a fit that starts near the true values."""
_FEW_ROWS = 20_000
"""With more rows the change is scored but not fitted: fitting every effect would take longer than the diagnosis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Injection:
    """A probe for a chosen model; `columns` (k, n) are its whitened columns that the model cannot follow."""

    problem: PartProblem
    chosen: Selection
    probe: Probe
    columns: FloatArray

    @classmethod
    def of(cls, problem: PartProblem, chosen: Selection, probe: Probe) -> Self:
        """Compute the probe's columns for the chosen model."""
        columns = own_columns(problem, chosen.whitener, chosen.after, probe.columns)
        return cls(problem=problem, chosen=chosen, probe=probe, columns=columns)

    def found_again(self, effect: DescribedEffect) -> bool:
        """Return whether the probe detects an effect that was added to the recording.

        The effect must satisfy the criteria of a finding: above chance, in all steps, and on held-out steps. For
        recordings with few rows the fitted effect must also satisfy them, with its parameters within their ranges.
        """
        after, step = self.chosen.after, self.problem.step
        added = own_columns(self.problem, self.chosen.whitener, after, [effect])[0]
        rows, white = after.fitted[step], after.white + added
        columns = self.columns * rows
        weights = inverse(columns @ columns.T) @ (columns @ white)
        left = white - weights @ self.columns
        return self._passes(left, white) and (step.size > _FEW_ROWS or self._fitted(effect, weights))

    def _passes(self, better: FloatArray, worse: FloatArray) -> bool:
        """Return whether the gain of one whitened residual over another exceeds scatter and held-out steps agree."""
        step = self.problem.step
        rows, held = self.chosen.after.fitted[step], self.chosen.heldout[step]
        explained, white = (worse - better) * rows, worse * rows
        by = max(scatter(explained, white, starts) for starts in (block_starts(step.size), step_starts(step)))
        gain = gain_on(better[rows], worse[rows]) / by - 2.0 * math.log(self.probe.places)
        return gain > self.chosen.least and gain_on(better[held], worse[held]) >= least_gain(better[held], worse[held])

    def _fitted(self, effect: DescribedEffect, weights: FloatArray) -> bool:
        """Return whether a fit to the recording with the added effect satisfies the criteria."""
        chosen, after = self.chosen, self.chosen.after
        added = self.problem.predict(after.point.baseline, (*after.point.effects, effect)) - after.predicted
        injected = cast(PartProblem, _Injected(self.problem, self.problem.measured + added))
        less = fit(injected, chosen.whitener, after, after.fitted, rounds=_ROUNDS)
        start = replace(less.point, effects=(*less.point.effects, self.probe.start(weights)))
        found = fit(injected, chosen.whitener, start, after.fitted)
        return (
            self._passes(found.white, less.white)
            and gain_kept(found, less, dealt(self.problem)) > 0.0
            and not at_bound(found.point.effects[-1])
        )


class _Injected:
    """A problem with other measured values."""

    def __init__(self, problem: PartProblem, measured: FloatArray) -> None:
        self._problem = problem
        self.measured = measured

    def __getattr__(self, name: str) -> Any:
        return getattr(self._problem, name)
