"""Diagnosis of a recording, from the samples to the result."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any

from threadpoolctl import threadpool_limits

from benchctl.diagnosis.data_faults import coarse_step_of, fault_findings, without_data_faults
from benchctl.diagnosis.earth_rate import other_answer, plainly_better
from benchctl.diagnosis.findings.figures import beyond_noise, figures_of
from benchctl.diagnosis.findings.findings import findings_of, noise_effects
from benchctl.diagnosis.findings.in_unit import finding_in, in_terms_of, not_found_in, pieces_in_time, unexplained_in
from benchctl.diagnosis.findings.located import slices_of, step_figures
from benchctl.diagnosis.findings.not_found import not_found_of, unseen_in
from benchctl.diagnosis.findings.traces import traces_of
from benchctl.diagnosis.findings.verdict import baseline_of, sentence_of, verdict_of
from benchctl.diagnosis.gyro.points_sine import with_sine
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.next_run.left_open import next_of
from benchctl.diagnosis.parts import part_of, problem_of
from benchctl.diagnosis.quantization import unrounded, without_the_steps_own
from benchctl.diagnosis.residual.attribution import NOTHING, named
from benchctl.diagnosis.result import Diagnosis, Part, Unexplained
from benchctl.diagnosis.search.scans import swinging_hz
from benchctl.diagnosis.search.select import Search, select, select_between, without_nothing
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.search.subsets import select_subset
from benchctl.diagnosis.stepped import PartProblem
from benchctl.diagnosis.structures.search import Modelled
from benchctl.diagnosis.structures.settled import names_do_better
from benchctl.diagnosis.structures.stated import evident_structure, with_structures
from benchctl.estimation.point import stands_at
from benchctl.recordings.reader import Recording

_MOST_UNROUNDED = 2
"""Maximum number of times a coarse converter's steps are removed: each time the prediction is more accurate."""


def diagnose(
    recording: Recording,
    *,
    model: Mapping[str, Any] | None = None,
    part: Part | None = None,
    seed: int = 0,
    without: Collection[str] = (),
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosis:
    """Find the effects that the lab's model of a part of the bench lacks, as far as the recording requires them.

    Without `part`, it is the one that the recording is of. `model` replaces the model that the recording names;
    hypotheses listed in `without` are not tested. `progress` is called with the name of the hypothesis under test and
    the completed share.

    Raises `UsageError` if the recording names no model or has too few usable rows.
    """
    # our own threads use all cores; with several BLAS threads the last digits would depend on their number
    with threadpool_limits(limits=1, user_api="blas"):
        part, progress = part or part_of(recording), progress or (lambda _name, _share: None)
        return _diagnosis(recording, model, part, seed, without, progress)


def _diagnosis(
    recording: Recording,
    model: Mapping[str, Any] | None,
    part: Part,
    seed: int,
    without: Collection[str],
    progress: Callable[[str, float], None],
) -> Diagnosis:
    problem, faults = without_data_faults(problem_of(recording, part, model=model, without=without))
    problem.require_rows(recording)
    step_v = coarse_step_of(problem, faults)
    rounding_v2 = step_v**2 / 12.0
    stated = problem
    problem, chosen, evident = _searched(problem, rounding_v2, faulty=bool(faults), seed=seed, progress=progress)
    settled = problem is not stated or evident is not None
    for _ in range(_MOST_UNROUNDED):
        smooth = unrounded(problem, chosen, step_v)
        if smooth is None:
            break
        problem, rounding_v2 = smooth, 0.0
        chosen = select(problem, seed=seed, progress=progress, chosen=chosen)
    chosen = without_the_steps_own(problem, chosen, step_v)
    if not settled and (other := other_answer(problem, chosen)) is not None:
        problem = other
        chosen = select(problem, seed=seed, progress=progress, rounding_v2=rounding_v2, chosen=chosen)
    progress("residual", 0.95)
    problem.forget()  # the following steps need no fast predictions
    tried = chosen.identifiers
    spikes = any(fault.effect == "outliers" for fault in faults)
    if evident is None:
        chosen, unexplained, notes = _attributed(problem, chosen, rounding_v2=rounding_v2, spikes=spikes, seed=seed)
    else:
        chosen, unexplained, notes = with_structures(
            problem, chosen, NOTHING, (), searched=chosen, evident=evident, seed=seed
        )
    chosen = without_nothing(problem, chosen)
    found = (*with_sine(problem, findings_of(problem, chosen)), *fault_findings(problem, faults))
    findings = tuple(finding_in(one, problem.unit, part) for one in found)
    if not (found or unexplained.significant):
        unexplained = beyond_noise(problem, chosen) or unexplained
    unexplained = unexplained_in(unexplained, problem.unit, part)
    if len(problem.step_names) > len(recording.infos):
        unexplained = pieces_in_time(unexplained)
    baseline = baseline_of(problem, chosen)
    verdict = verdict_of(problem, findings, unexplained, baseline)
    rows = chosen.heldout[problem.step]
    names = {name for one in findings for name in (one.effect, *(other.effect for other in one.alternatives))}
    remarks = problem.remarks(chosen.before.residual, chosen.after.residual, rows)
    return Diagnosis(
        recording=recording.path.name,
        part=part,
        verdict=verdict,
        says=sentence_of(verdict, findings, unexplained),
        baseline=baseline,
        findings=findings,
        unexplained=unexplained,
        fit=figures_of(problem, chosen),
        next_experiment=next_of(problem, chosen, findings, unexplained, recording.meta, progress),
        not_found=tuple(
            not_found_in(one, problem.unit, part)
            for one in not_found_of(problem, chosen, names | tried, unexplained=unexplained.significant)
        ),
        slices=slices_of(problem, chosen),
        steps=step_figures(problem, chosen),
        traces=traces_of(problem, chosen, faults),
        notes=(
            *(in_terms_of(one, part) for one in notes),
            *unseen_in(chosen, names),
            *remarks,
            *_at_bounds(problem, chosen),
        ),
        model=_model(problem, chosen),
        threshold=chosen.screening.threshold,
        seed=seed,
    )


def _searched(
    problem: PartProblem, rounding_v2: float, *, faulty: bool, seed: int, progress: Callable[[str, float], None]
) -> tuple[PartProblem, Selection, Modelled | None]:
    """Return the problem under the better assumption, the chosen effects, and a structure if it alone suffices."""
    if problem.disturbed:
        return problem, select_subset(problem, seed=seed, progress=progress), None
    search = Search(problem, seed, progress, rounding_v2)
    if isinstance(problem, GyroProblem) and not (faulty or problem.is_long or swinging_hz(problem)):
        bare = search.bare()
        evident = None if bare is None else evident_structure(problem, bare, seed=seed)
        if bare and evident and plainly_better(problem, evident.chosen.after, evident.chosen.whitener) is None:
            return problem, bare, evident
    problem, chosen = select_between(
        problem, plainly_better, seed=seed, progress=progress, rounding_v2=rounding_v2, begun=search
    )
    return problem, chosen, None


def _attributed(
    problem: PartProblem, searched: Selection, *, rounding_v2: float, spikes: bool, seed: int
) -> tuple[Selection, Unexplained, tuple[str, ...]]:
    """Return the selection after naming, the unexplained part with its model, and notes.

    Names that another cause could replace are kept if no other model does equally well. In a swing at one frequency all
    motion coordinates are equivalent, so that a structure along them can follow anything: none argues against a name.
    """
    tried = searched.identifiers
    left = named(problem, searched, rounding_v2=rounding_v2, seed=seed)
    dropped = tried - left[0].identifiers
    if not dropped or not isinstance(problem, GyroProblem):
        return with_structures(problem, *left, searched=searched, spikes=spikes, seed=seed)
    modelled = None
    if not swinging_hz(problem):
        modelled = with_structures(problem, *left, searched=searched, spikes=spikes, seed=seed)
        if not names_do_better(problem, searched, modelled[0], seed=seed):
            return modelled
    left = named(problem, searched, rounding_v2=rounding_v2, contested=True, seed=seed)
    if modelled is not None and left[0].identifiers == tried - dropped:
        return modelled
    return with_structures(problem, *left, searched=searched, spikes=spikes, seed=seed)


def _at_bounds(problem: PartProblem, chosen: Selection) -> Iterator[str]:
    """Yield sentences about baseline parameters that are at the bound of the plausible range."""
    units = dict(zip(problem.baseline_names, problem.baseline_units, strict=True))
    for number, value in zip(chosen.full.numbers, chosen.full.point.baseline.tolist(), strict=False):
        if stands_at(value, number.low, number.high):
            yield (
                f"{number.name} is {value:.4g} {units[number.name]}, a bound of its plausible range"
                f" ({number.low:.4g} to {number.high:.4g}): the recording does not determine it, or something that acts"
                " alike is missing."
            )


def _model(problem: PartProblem, chosen: Selection) -> dict[str, Any]:
    """Return the content of the model file."""
    unnamed = () if chosen.noise_structure is None else (chosen.noise_structure,)
    effects = (*chosen.full.point.effects, *noise_effects(chosen), *unnamed)
    tables = problem.model_of(chosen.full.point.baseline, effects, chosen.white_deviation)
    return {"format": "benchctl-model/1"} | tables
