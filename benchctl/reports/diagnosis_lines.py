"""A diagnosis as short lines for the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from benchctl.diagnosis.result import Diagnosis, Estimate, Finding
from benchctl.plan.written import as_texts
from benchctl.reports import diagnosis_words as words
from benchctl.reports import text


def lines(diagnosis: Diagnosis, unit: str) -> Iterator[str]:
    """Verdict, findings, what is left, how well it fits, what to do next."""
    yield f"{diagnosis.verdict}: {diagnosis.says}"
    for number, finding in enumerate(diagnosis.findings, 1):
        yield from _finding(number, finding)
    if diagnosis.unexplained.significant:
        where = ", ".join(words.coordinate(name) for name in diagnosis.unexplained.coordinates)
        yield f"unexplained, along {where}: {diagnosis.unexplained.says}"
    fit = diagnosis.fit
    before, after = (
        f"{words.size(rms, unit)} ({words.times_noise(rms, fit.noise_v)})"
        for rms in (fit.heldout_before_v, fit.heldout_after_v)
    )
    yield f"residual on held-out steps, rms: {before} before, {after} after"
    blind = [one.effect for one in diagnosis.not_found if one.smallest is None]
    if blind:
        yield f"could not be seen in this recording: {', '.join(blind)}"
    for note in diagnosis.notes:
        yield f"note: {note}"
    if diagnosis.next_experiment.says:
        yield f"next: {diagnosis.next_experiment.says}"
    if command := next_command(diagnosis):
        yield f"  {command}"


def next_command(diagnosis: Diagnosis) -> str:
    """How the next experiment is run; empty where there is none."""
    following = diagnosis.next_experiment
    if not following.procedure:
        return ""
    given = "".join(f" -p {name}={value}" for name, value in as_texts(following.parameters).items())
    return f"benchctl run {following.procedure} --bench bench.toml{given}"


def _finding(number: int, finding: Finding) -> Iterator[str]:
    yield f"{number}. {finding.effect} ({words.probability(finding.probability)}): {finding.says}"
    for name, value in finding.parameters.items():
        yield f"     {name} = {_estimate(value)}"
    if finding.alternatives:
        others = ", ".join(f"{one.effect} ({words.probability(one.probability)})" for one in finding.alternatives)
        yield f"     or else: {others}"


def _estimate(value: Estimate) -> str:
    ends = f"  [{value.low:.5g}, {value.high:.5g}]" if value.high > value.low else ""
    return f"{text.with_unit(f'{value.value:.5g}', text.unit_text(value.unit))}{ends}"
