"""The verdict: what a recording says of its lab's model, in a word and in a sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from benchctl.diagnosis.result import Estimate, Finding, Unexplained, Verdict
from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.problem import Problem
from benchctl.signals.normal import Z95

_MOVED_ERRORS = 5.0
_MOVED_SHARE = 1e-4
"""A parameter has moved beyond five standard errors and beyond 1e-4 of the scale factor or of full scale."""


def baseline_of(problem: Problem, chosen: Selection) -> dict[str, Estimate]:
    """The parameters of the lab's model, refitted; `was` where a lab believed in other values.

    An interval ends where what is plausible does. Of what the recording does not show at all it has no other ends, and
    none where a lab's model states the parameter.
    """
    errors = (Z95 * np.sqrt(np.diag(chosen.whole.robust_covariance(problem.step)))).tolist()
    errors = [error if error > 0.0 else math.inf for error in errors]
    bounds = problem.baseline_bounds
    columns = zip(
        problem.baseline_names,
        problem.baseline_units,
        chosen.whole.point.baseline.tolist(),
        errors,
        problem.baseline_start.tolist(),
        strict=False,
    )
    estimates = {}
    for name, unit, value, error, was in columns:
        shown = math.isfinite(error) or not problem.believed
        least, most = bounds.get(name, (-math.inf, math.inf)) if shown else (-math.inf, math.inf)
        estimates[name] = Estimate(
            value=value,
            low=max(value - error, min(least, value)),
            high=min(value + error, max(most, value)),
            unit=unit,
            was=was if problem.believed else None,
        )
    return estimates


def verdict_of(
    problem: Problem, findings: Sequence[Finding], unexplained: Unexplained, baseline: Mapping[str, Estimate]
) -> Verdict:
    """Missing physics before an unknown structure, that before moved parameters."""
    if findings:
        return "missing-physics"
    if unexplained.significant:
        return "unknown-structure"
    for name, one in baseline.items():
        if one.was is None:
            continue
        change = one.value - one.was
        surely = abs(change) > _MOVED_ERRORS * (one.high - one.value) / Z95
        if surely and problem.matters(name, change) > _MOVED_SHARE:
            return "recalibrate"
    return "consistent"


def sentence_of(verdict: Verdict, findings: Sequence[Finding], unexplained: Unexplained) -> str:
    """The verdict for someone who was not there."""
    said = [one.says for one in findings]
    if unexplained.significant:
        said.append(unexplained.says)
    if said:
        return " ".join(said)
    if verdict == "recalibrate":
        return "No physics is missing; the model's own parameters have moved and want recalibrating."
    return "The model agrees with the recording to within its noise."
