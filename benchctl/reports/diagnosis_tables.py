"""The sections and tables of a diagnosis page, and the diagnosis as lines for the terminal."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from benchctl.diagnosis.result import Diagnosis, Estimate, Finding, NotFound, StructureModel
from benchctl.plan.written import as_texts
from benchctl.reports import diagnosis_words as words
from benchctl.reports import text
from benchctl.reports.diagnosis_words import Kind, changed, headline, kind_of, moved, title
from benchctl.reports.vocabulary import advice_for
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.physics.structures import structure_named

_SHARES: Mapping[Kind, str] = {
    "physics": "what the noise does not account for",
    "noise": "what white noise does not account for",
    "data": "the samples that it spoils",
}
_UNCERTAINTY = re.compile(r"\(?([^( ]+) ± [^ )]+\)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRow:
    """A parameter; `value` is unrounded, the other fields are text. `was` and `change` are empty for new ones."""

    name: str
    says: str
    value: float
    stated: str
    interval: str
    was: str = ""
    change: str = ""


def known_effects() -> dict[str, type[DescribedEffect]]:
    """Return the known effects of all parts of a bench, by identifier."""
    return {**effects(), **drive_effects(), **chamber_effects()}


def finding_section(
    finding: Finding, known: Mapping[str, type[DescribedEffect]], threshold: float, unit: str
) -> dict[str, object]:
    """Return a finding, with description and equation of the effect if it is a known one.

    `threshold` is the chance level, `unit` that of the diagnosed quantity.
    """
    kind = known.get(finding.effect)
    meanings = {name: one.meaning for name, one in kind.parameters.items()} if kind else {}
    return {
        "title": title(finding.effect),
        "effect": finding.effect,
        "says": words.prose(finding.says),
        "words": kind.words if kind else "",
        "equation": kind.equation if kind else "",
        "place": words.place(finding.where, unit, _SHARES[kind_of(finding.effect)]),
        "parameters": tuple(_parameter(name, value, meanings) for name, value in finding.parameters.items()),
        "evidence": tuple(_evidence(finding, threshold)),
        "alternatives": tuple(
            (title(other.effect), words.probability(other.probability), words.likelihood(other.loss))
            for other in finding.alternatives
        ),
        "alone": kind_of(finding.effect) == "physics" and not finding.alternatives,
        "advice": advice_for(finding.effect),
    }


def structure_section(one: StructureModel) -> dict[str, object]:
    """Return an empirical model with its formula and its parameters."""
    kind = structure_named(one.identifier)
    meanings = {} if kind is None else {name: known.meaning for name, known in kind.parameters.items()}
    return {
        "title": f"{one.shape.replace('_', ' ').capitalize()} of the {one.stage} over the"
        f" {' and '.join(words.coordinate(name) for name in one.coordinates)}",
        "formula": one.formula,
        "parameters": tuple(_parameter(name, value, meanings) for name, value in one.parameters.items()),
        "explains": text.percent(100 * one.explains),
        "hints": one.hints,
    }


def _evidence(finding: Finding, threshold: float) -> Iterator[tuple[str, str]]:
    yield "Probability", words.probability(finding.probability)
    yield (
        "Gain on all data",
        f"{words.likelihood(finding.gain)} in twice the log likelihood; chance alone may reach"
        f" {words.likelihood(threshold)}",
    )
    kind = kind_of(finding.effect)
    if kind == "data":
        if finding.explains > 0:
            yield "Samples it spoils", f"{text.percent(100 * finding.explains)} of all, left out before and after"
        return
    if kind == "physics":
        gain = words.likelihood(finding.gain_heldout)
        yield "Gain on held-out steps", f"{gain}, on data that chose and fitted nothing"
    yield "Share of the mismatch", text.percent(100 * finding.explains)


def not_found_row(one: NotFound) -> dict[str, object]:
    """Return a row of the effects tested and not found; the size is that of its parameter, with the others fixed."""
    return {
        "title": title(one.effect),
        "effect": one.effect,
        "smallest": f"{one.parameter} = {text.with_unit(text.number(one.smallest, 2), words.unit(one.unit))}",
        "held": ", ".join(f"{name} = {_held(value)}" for name, value in one.others.items()),
    }


def baseline_rows(baseline: Mapping[str, Estimate]) -> list[ParameterRow]:
    """Return the model's own parameters before and after the refit."""
    return [
        _parameter(
            name, value, {}, was="" if value.was is None else _like(value.was, value), change=words.change(value)
        )
        for name, value in baseline.items()
    ]


def fit_rows(diagnosis: Diagnosis, unit: str) -> list[tuple[str, str, str]]:
    """Return the rms of the residuals, each relative to the noise."""
    fit = diagnosis.fit
    rows: Sequence[tuple[str, float]] = (
        ("noise of the recording", fit.noise),
        ("fitted steps, before", fit.before),
        ("fitted steps, after", fit.after),
        ("held-out steps, before (parameters refitted)", fit.heldout_before),
        ("held-out steps, after (parameters refitted, with the findings)", fit.heldout_after),
    )
    if not changed(diagnosis):
        rows = (
            rows[0],
            ("fitted steps, its parameters refitted", fit.before),
            ("held-out steps", fit.heldout_before),
        )
    return [(name, words.size(rms, unit), words.times_noise(rms, fit.noise)) for name, rms in rows]


def _parameter(
    name: str, value: Estimate, meanings: Mapping[str, str], *, was: str = "", change: str = ""
) -> ParameterRow:
    return ParameterRow(
        name=name,
        says=meanings.get(name, ""),
        value=value.value,
        stated=words.estimate(value),
        interval=words.interval(value),
        was=was,
        change=change,
    )


def _like(was: float, now: Estimate) -> str:
    """Return the former value of a parameter with the decimals and the power of ten of the current one."""
    stated = words.estimate(replace(now, value=was, low=was - now.value + now.low, high=was - now.value + now.high))
    return _UNCERTAINTY.sub(r"\1", stated)


def _held(value: float) -> str:
    return text.plain(value, decimals=0) if value == round(value) else text.number(value, 3)


_WIDTH = 100


def lines(diagnosis: Diagnosis, unit: str) -> Iterator[str]:
    """Yield verdict, findings, unexplained residual, goodness of fit and next step; a command is kept on one line."""
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
    """Return the command that runs the next experiment; empty if there is none."""
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
    residuals = (
        f"{before} before, {after} after" if changed(diagnosis) else f"{after}, the model's own parameters refitted"
    )
    return f"residual on held-out steps, rms: {residuals}"


def _wrapped(line: str, indent: str = "") -> list[str]:
    """Wrap to lines of at most `_WIDTH` characters with a hanging indent; a number stays with its unit."""
    return textwrap.wrap(
        line,
        _WIDTH,
        initial_indent=indent,
        subsequent_indent=f"{indent}   ",
        break_long_words=False,
        break_on_hyphens=False,
    )
