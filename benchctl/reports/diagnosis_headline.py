"""The verdict of a diagnosis in a word and in a sentence or two: what kind of thing was found, each by its name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from benchctl.diagnosis.result import Diagnosis, Estimate, Finding, Verdict
from benchctl.reports import diagnosis_words as words

Kind = Literal["physics", "noise", "data"]

WANDERING = ("bias_random_walk", "flicker_noise")
GROWING = "noise_rate_dependent"

_KINDS: Mapping[str, Kind] = {
    **dict.fromkeys(("outliers", "dropouts", "adc_coarse", "saturation", "two_rails"), "data"),
    **dict.fromkeys((*WANDERING, GROWING), "noise"),
}
_VERDICTS: Mapping[Verdict, str] = {
    "consistent": "Consistent",
    "recalibrate": "Recalibrate",
    "missing-physics": "Physics is missing",
    "unknown-structure": "Unknown structure",
}
_ONLY: Mapping[Kind, str] = {"physics": "Physics is missing", "noise": "Noise not as modelled", "data": "Faulty data"}
_MOVED_ERRORS = 5.0


def kind_of(effect: str) -> Kind:
    """Whether a finding is of the physics, of the noise, or a fault of the data."""
    return _KINDS.get(effect, "physics")


def title(effect: str) -> str:
    """An identifier in plain letters: `thermal_lag` becomes thermal lag."""
    return effect.replace("_", " ")


def chip(diagnosis: Diagnosis) -> str:
    """The verdict in two or three words."""
    kinds: list[Kind] = sorted({kind_of(one.effect) for one in diagnosis.findings})
    return _ONLY[kinds[0]] if len(kinds) == 1 else _VERDICTS[diagnosis.verdict]


def headline(diagnosis: Diagnosis) -> str:
    """The verdict for someone who was not there, without the findings' own sentences."""
    if not diagnosis.findings and not diagnosis.unexplained.significant:
        return diagnosis.says
    told = [
        f"{beginning}: {names}."
        for kind, beginning in (
            ("physics", "The data demand physics that the model does not have"),
            ("noise", "The noise is not what the model says"),
            ("data", "The data have faults, which are left out of all figures"),
        )
        if (names := _names(diagnosis.findings, kind))
    ]
    if diagnosis.unexplained.significant:
        also = "Beside that something" if told else "Something"
        told.append(f"{also} is left that is not noise, and no known effect accounts for it.")
    return " ".join(told)


def moved(diagnosis: Diagnosis) -> dict[str, Estimate]:
    """Those parameters of the lab's model that are surely not what they were."""
    return {
        name: one
        for name, one in diagnosis.baseline.items()
        if one.was is not None and abs(one.value - one.was) > _MOVED_ERRORS * words.standard_error(one)
    }


def changed(diagnosis: Diagnosis) -> bool:
    """Whether what is left differs before and after: faults of the data are left out in both."""
    return bool(diagnosis.unexplained.models) or any(kind_of(one.effect) != "data" for one in diagnosis.findings)


def predicts_otherwise(diagnosis: Diagnosis) -> bool:
    """Whether the model with the findings predicts other samples; noise that only grows changes what they weigh."""
    return bool(diagnosis.unexplained.models) or any(
        kind_of(one.effect) == "physics" or one.effect in WANDERING for one in diagnosis.findings
    )


def _names(findings: Sequence[Finding], kind: str) -> str:
    return words.listed(list(dict.fromkeys(title(one.effect) for one in findings if kind_of(one.effect) == kind)))
