"""The questions that a diagnosis leaves open, and the run that would decide them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from benchctl.diagnosis.drive.problem import DriveProblem
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of_names
from benchctl.diagnosis.next_run.candidates import bench_of_recording
from benchctl.diagnosis.next_run.experiment import NOTHING_OPEN, OpenPair, next_experiment
from benchctl.diagnosis.next_run.repeated import repeat_along, rest_longer
from benchctl.diagnosis.next_run.sampled import SampleNoise
from benchctl.diagnosis.result import Finding, NextExperiment, Unexplained
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import fit
from benchctl.estimation.wandering import PROCESSES
from benchctl.recordings.model import Meta


def next_of(
    problem: PartProblem,
    chosen: Selection,
    findings: Sequence[Finding],
    unexplained: Unexplained,
    meta: Meta,
    progress: Callable[[str, float], None],
) -> NextExperiment:
    """Return the run that best separates each finding from its nearest alternative, or shows what is unexplained."""
    if not isinstance(problem, GyroProblem):
        return next_by_hand(problem, findings, unexplained)
    bench = bench_of_recording(meta)
    pairs = list(_pairs(problem, chosen, findings))
    if pairs:
        white_v = chosen.white_deviation
        wanders = chosen.noise.found.get("bias_random_walk")
        noise = SampleNoise(white_v=white_v, walk_v_per_sqrt_s=0.0 if wanders is None else wanders.size * white_v)
        return next_experiment(problem, noise, pairs, bench=bench, progress=lambda name: progress(name, 0.98))
    wandering = next((one for one in findings if one.effect in PROCESSES and one.alternatives), None)
    if wandering is not None:
        return rest_longer(problem, (wandering.effect, wandering.alternatives[0].effect), bench=bench)
    if unexplained.significant:
        return repeat_along(problem, unexplained.coordinates, bench=bench)
    return NOTHING_OPEN


def _pairs(problem: GyroProblem, chosen: Selection, findings: Sequence[Finding]) -> Iterator[OpenPair]:
    for key, one in zip(keys_of_names(one.effect for one in findings), findings, strict=True):
        evidence = chosen.evidence.get(key)
        if not one.alternatives or evidence is None or evidence.nearest is None:
            continue
        second = fit(problem, chosen.whitener, evidence.nearest, chosen.after.fitted)
        yield OpenPair(finding=one.effect, rival=one.alternatives[0].effect, first=chosen.after, second=second)


_TOGETHER = "and diagnose both recordings together"


def next_by_hand(problem: PartProblem, findings: Sequence[Finding], unexplained: Unexplained) -> NextExperiment:
    """Return the run that separates the findings from their alternatives, or shows more of the unexplained part."""
    open_ones = [one for one in findings if one.alternatives]
    names = tuple(dict.fromkeys(name for one in open_ones for name in (one.effect, one.alternatives[0].effect)))
    if isinstance(problem, DriveProblem) and problem.turns_one_way and (findings or unexplained.significant):
        cannot = f", which cannot separate {' from '.join(names)}" if names else ""
        return NextExperiment(
            says=f"The table turned one way only{cannot}: run it in the other direction of rotation, {_TOGETHER}.",
            separates=names,
        )
    if names:
        wanted = "; ".join(dict.fromkeys(problem.effects[name].excited_by for name in names if name in problem.effects))
        return NextExperiment(
            says=f"This recording does not separate {' from '.join(names)}: record {wanted}, {_TOGETHER}.",
            separates=names,
        )
    if unexplained.significant:
        along = " and ".join(unexplained.coordinates) or "no single coordinate"
        how = "for longer" if along == "time" else "over a wider range of it where possible"
        return NextExperiment(
            says=f"The unexplained part depends on {along}: record again, {how}, {_TOGETHER}; what repeats belongs"
            " to the bench."
        )
    return NOTHING_OPEN
