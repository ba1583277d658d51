"""The parts of a diagnosis as a page prints them: findings, what was not found, parameters, misfits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchctl.diagnosis.result import Diagnosis, Estimate, Finding, NotFound
from benchctl.reports import diagnosis_words as words
from benchctl.reports import text
from instruments.physics.effects.effect import DescribedEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRow:
    """A parameter; `value` is unrounded, the rest is text. `was` and `change` are empty where there was none before."""

    name: str
    says: str
    value: float
    stated: str
    interval: str
    was: str = ""
    change: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingSection:
    """A finding with what is known of its effect; `words` and `equation` are empty where nothing is."""

    title: str
    effect: str
    says: str
    words: str
    equation: str
    place: str
    parameters: tuple[ParameterRow, ...]
    evidence: tuple[tuple[str, str], ...]
    alternatives: tuple[tuple[str, str, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class NotFoundRow:
    """An effect that was looked for, and the smallest size of it that would have shown; `why` where none would."""

    title: str
    effect: str
    smallest: str
    held: str
    why: str


def title(effect: str) -> str:
    """An identifier in plain letters: `thermal_lag` becomes thermal lag."""
    return effect.replace("_", " ")


def finding_section(finding: Finding, known: Mapping[str, type[DescribedEffect]], threshold: float) -> FindingSection:
    """A finding, with the words and the equation of the effect where it is a known one; `threshold` is chance's."""
    kind = known.get(finding.effect)
    meanings = {name: one.meaning for name, one in kind.parameters.items()} if kind else {}
    return FindingSection(
        title=title(finding.effect),
        effect=finding.effect,
        says=finding.says,
        words=kind.words if kind else "",
        equation=kind.equation if kind else "",
        place=words.place(finding.where),
        parameters=tuple(_parameter(name, value, meanings) for name, value in finding.parameters.items()),
        evidence=(
            ("Probability", words.probability(finding.probability)),
            ("Gain on all data", f"{text.plain(finding.gain)}; chance alone may reach {text.plain(threshold)}"),
            ("Gain on held-out steps", f"{text.plain(finding.gain_heldout)}, on data that chose and fitted nothing"),
            ("Share of the mismatch", text.percent(100 * finding.explains)),
        ),
        alternatives=tuple(
            (title(other.effect), words.probability(other.probability), text.plain(other.loss))
            for other in finding.alternatives
        ),
    )


def not_found_row(one: NotFound) -> NotFoundRow:
    """A line of what was looked for; the size is that of its parameter, the others being held."""
    smallest = ""
    if one.smallest is not None:
        smallest = f"{one.parameter} = {text.with_unit(text.number(one.smallest, 2), text.unit_text(one.unit))}"
    return NotFoundRow(
        title=title(one.effect),
        effect=one.effect,
        smallest=smallest,
        held=", ".join(f"{name} = {text.number(value, 3)}" for name, value in one.others.items()),
        why=one.says,
    )


def baseline_rows(diagnosis: Diagnosis) -> list[ParameterRow]:
    """The model's own parameters, as they were and as they are once refitted."""
    return [
        _parameter(
            name, value, {}, was="" if value.was is None else _like(value.was, value), change=words.change(value)
        )
        for name, value in diagnosis.baseline.items()
    ]


def fit_rows(diagnosis: Diagnosis, unit: str) -> list[tuple[str, str, str]]:
    """Rms of the residuals, each beside the noise."""
    fit = diagnosis.fit
    rows: Sequence[tuple[str, float]] = (
        ("noise of the recording", fit.noise_v),
        ("all steps, before", fit.before_v),
        ("all steps, after", fit.after_v),
        ("held-out steps, before (parameters refitted)", fit.heldout_before_v),
        ("held-out steps, after (parameters refitted, with the findings)", fit.heldout_after_v),
    )
    return [(name, words.size(rms, unit), words.times_noise(rms, fit.noise_v)) for name, rms in rows]


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
    """What a parameter was, to as many digits as tell it from what it is now."""
    return text.with_unit(text.number(was, 6), text.unit_text(now.unit))
