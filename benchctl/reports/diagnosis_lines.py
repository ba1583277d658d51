"""A diagnosis as short lines for the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from benchctl.diagnosis.result import Diagnosis, Finding
from benchctl.plan.written import as_texts
from benchctl.reports import diagnosis_words as words
from benchctl.reports.diagnosis_headline import changed, headline, moved
from benchctl.reports.diagnosis_tables import baseline_rows

_WIDTH = 100


def lines(diagnosis: Diagnosis, unit: str) -> Iterator[str]:
    """Verdict, findings, what is left, how well it fits, what to do next; a command stays on one line."""
    yield from _wrapped(f"{diagnosis.verdict}: {words.prose(headline(diagnosis))}")
    for number, finding in enumerate(diagnosis.findings, 1):
        yield from _finding(number, finding)
    if diagnosis.verdict == "recalibrate":
        for row in baseline_rows(moved(diagnosis)):
            yield from _wrapped(f"{row.name}: {row.was} → {row.stated} ({row.change})", "  ")
    if diagnosis.unexplained.significant:
        yield from _wrapped(f"unexplained: {words.prose(diagnosis.unexplained.says)}")
    for model in diagnosis.unexplained.models:
        yield from _wrapped(f"model: {model.formula}", "  ")
        if model.hints:
            yield from _wrapped(f"causes of this kind (hints): {'; '.join(model.hints)}", "  ")
    yield from _wrapped(_fit(diagnosis, unit))
    for note in diagnosis.notes:
        yield from _wrapped(f"note: {words.prose(note)}")
    if diagnosis.next_experiment.says:
        yield from _wrapped(f"next: {words.prose(diagnosis.next_experiment.says)}")
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
    chance = words.probability(finding.probability)
    yield from _wrapped(f"{number}. {finding.effect} ({chance}): {words.prose(finding.says)}")
    for name, value in finding.parameters.items():
        interval = words.interval(value) if value.high > value.low else ""
        yield from _wrapped(f"{name} = {words.estimate(value)}  {interval}".rstrip(), "     ")
    if finding.alternatives:
        others = ", ".join(f"{one.effect} ({words.probability(one.probability)})" for one in finding.alternatives)
        yield from _wrapped(f"or else: {others}", "     ")


def _fit(diagnosis: Diagnosis, unit: str) -> str:
    fit = diagnosis.fit
    before, after = (
        f"{words.size(rms, unit)} ({words.times_noise(rms, fit.noise)})"
        for rms in (fit.heldout_before, fit.heldout_after)
    )
    told = f"{before} before, {after} after" if changed(diagnosis) else f"{after}, the model's own parameters refitted"
    return f"residual on held-out steps, rms: {told}"


def _wrapped(told: str, indent: str = "") -> list[str]:
    """Lines of at most so many characters, the further ones set in; a number stays with its unit."""
    return textwrap.wrap(
        told,
        _WIDTH,
        initial_indent=indent,
        subsequent_indent=f"{indent}   ",
        break_long_words=False,
        break_on_hyphens=False,
    )
