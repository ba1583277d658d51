"""A diagnosis of a recording, from the samples to what it says."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from threadpoolctl import threadpool_limits

from benchctl.diagnosis.cleaned import cleaned, coarse_step_of, fault_findings
from benchctl.diagnosis.findings.findings import findings_of, noise_effects
from benchctl.diagnosis.findings.located import slices_of, step_figures
from benchctl.diagnosis.findings.not_found import not_found_of
from benchctl.diagnosis.findings.traces import traces_of
from benchctl.diagnosis.findings.verdict import baseline_of, sentence_of, verdict_of
from benchctl.diagnosis.fitting.fit import Fit
from benchctl.diagnosis.next_run.left_open import next_of
from benchctl.diagnosis.parts import Part, problem_of
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.rest.named import named
from benchctl.diagnosis.result import Diagnosis, FitFigures
from benchctl.diagnosis.rounded import unrounded, without_the_steps_own
from benchctl.diagnosis.search.select import select, select_between
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.unstated import other_answer, plainly_better
from benchctl.recordings.reader import Recording

BoolArray = npt.NDArray[np.bool_]

_MOST_UNROUNDED = 2
"""How often a coarse converter's steps are taken off: with what was found meanwhile the prediction is closer."""


def diagnose(
    recording: Recording,
    *,
    model: Mapping[str, Any] | None = None,
    part: Part = "gyro",
    seed: int = 0,
    without: Collection[str] = (),
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosis:
    """What physics the lab's model of a part of the bench leaves out, as far as the recording demands it.

    `model` takes the place of the one that the recording names; hypotheses `without` are not tried. `progress` is told
    what is being tried and the share that is done.

    Raises `UsageError` where the recording names no model, or holds too little of the part.
    """
    # the cores have threads of ours, and digits would depend on how many of its own BLAS has
    with threadpool_limits(limits=1, user_api="blas"):
        return _diagnosis(recording, model, part, seed, without, progress or (lambda _name, _share: None))


def _diagnosis(
    recording: Recording,
    model: Mapping[str, Any] | None,
    part: Part,
    seed: int,
    without: Collection[str],
    told: Callable[[str, float], None],
) -> Diagnosis:
    problem, faults = cleaned(problem_of(recording, part, model=model, without=without))
    step_v = coarse_step_of(problem, faults)
    rounding_v2 = step_v**2 / 12.0
    stated = problem
    problem, chosen = select_between(problem, plainly_better, seed=seed, progress=told, rounding_v2=rounding_v2)
    settled = problem is not stated
    for _ in range(_MOST_UNROUNDED):
        smooth = unrounded(problem, chosen, step_v)
        if smooth is None:
            break
        problem, rounding_v2 = smooth, 0.0
        chosen = select(problem, seed=seed, progress=told, chosen=chosen)
    chosen = without_the_steps_own(problem, chosen, step_v)
    if not settled and (other := other_answer(problem, chosen)) is not None:
        problem = other
        chosen = select(problem, seed=seed, progress=told, rounding_v2=rounding_v2, chosen=chosen)
    told("what is left", 0.95)
    problem.forget()  # what is left is found without predictions
    chosen, unexplained, owed = named(problem, chosen, rounding_v2=rounding_v2, seed=seed)
    findings = (*findings_of(problem, chosen), *fault_findings(problem, faults))
    baseline = baseline_of(problem, chosen)
    verdict = verdict_of(problem, findings, unexplained, baseline)
    rows = chosen.heldout[problem.step]
    return Diagnosis(
        recording=recording.path.name,
        verdict=verdict,
        says=sentence_of(verdict, findings, unexplained),
        baseline=baseline,
        findings=findings,
        unexplained=unexplained,
        fit=_figures(problem, chosen),
        next_experiment=next_of(problem, chosen, findings, unexplained, recording.meta, told),
        not_found=not_found_of(chosen, {one.effect for one in findings}),
        slices=slices_of(problem, chosen),
        steps=step_figures(problem, chosen),
        traces=traces_of(problem, chosen, faults),
        notes=(*owed, *problem.remarks(chosen.before.residual, chosen.after.residual, rows)),
        model=_model(problem, chosen),
        threshold=chosen.screening.threshold,
        seed=seed,
    )


def _rms(one: Fit, steps: BoolArray) -> float:
    rows = float(one.products.rows[steps].sum())
    return math.sqrt(float(one.products.squares[steps].sum()) / max(rows, 1.0))


def _figures(problem: Problem, chosen: Selection) -> FitFigures:
    """Rms of innovations, weighed by row where the noise is not of one size."""
    resting = np.array([kind == "static" for kind in problem.step_kinds]) & ~chosen.heldout
    steps = resting if resting.any() else ~chosen.heldout
    return FitFigures(
        noise_v=_rms(chosen.after, steps),
        before_v=_rms(chosen.before, ~chosen.heldout),
        after_v=_rms(chosen.after, ~chosen.heldout),
        heldout_before_v=_rms(chosen.before, chosen.heldout),
        heldout_after_v=_rms(chosen.after, chosen.heldout),
    )


def _model(problem: Problem, chosen: Selection) -> dict[str, Any]:
    """The content of the model file."""
    effects = (*chosen.whole.point.effects, *noise_effects(chosen))
    tables = problem.model_of(chosen.whole.point.baseline, effects, chosen.white_deviation)
    return {"format": "benchctl-model/1"} | tables
