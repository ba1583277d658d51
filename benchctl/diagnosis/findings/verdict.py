"""The verdict: the agreement of a recording with the lab's model, as one word and as a sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from benchctl.diagnosis.result import Estimate, Finding, Unexplained, Verdict
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.signals.normal import Z95

_MOVED_ERRORS = 5.0
_MOVED_SHARE = 1e-4
"""A parameter has changed if it differs by five standard errors and by 1e-4 of scale factor or full scale."""


def baseline_of(problem: PartProblem, chosen: Selection) -> dict[str, Estimate]:
    """Return the refitted parameters of the lab's model; `was` is the lab's previous value, if any.

    An interval is limited to the plausible range. A parameter that the recording does not determine has an interval
    equal to that range, or an unlimited one if a lab's model states the parameter.
    """
    errors = (Z95 * chosen.full.standard_errors(problem.step)).tolist()
    bounds = problem.baseline_bounds
    columns = zip(
        problem.baseline_names,
        problem.baseline_units,
        chosen.full.point.baseline.tolist(),
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
    problem: PartProblem, findings: Sequence[Finding], unexplained: Unexplained, baseline: Mapping[str, Estimate]
) -> Verdict:
    """Return the verdict: missing physics takes precedence over unknown structure, that over changed parameters."""
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
    """Return the verdict as a sentence that needs no knowledge of the recording."""
    sentences = [one.says for one in findings]
    if unexplained.significant:
        sentences.append(unexplained.says)
    if sentences:
        return " ".join(sentences)
    if verdict == "recalibrate":
        return "No physics is missing; the model's own parameters have changed; recalibrate."
    return "The model agrees with the recording to within its noise."
