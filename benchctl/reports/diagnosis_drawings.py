"""The figures of a diagnosis with their captions, and in words for who cannot see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from benchctl.diagnosis.result import Diagnosis, Slice
from benchctl.reports import diagnosis_words as words
from benchctl.reports.diagnosis_figures import map_figure, significance, steps_figure, traces_figure
from benchctl.reports.diagnosis_headline import GROWING, WANDERING, changed, predicts_otherwise
from benchctl.reports.figures import Drawing, inline_svg, style

_FOLLOWED = " After, the wandering bias is followed from sample to sample."
_WEIGHED = " After, each sample is weighed by the noise that its rate brings, and should come to the noise at rest."


def drawings(diagnosis: Diagnosis, unit: str) -> Mapping[str, Drawing]:
    """Those figures that there is something to draw for, by name: map, steps, traces."""
    found: dict[str, Drawing] = {}
    both = predicts_otherwise(diagnosis)
    before_after = "before and after" if both else "the model's own parameters refitted"

    def add(name: str, figure: Figure, alt: str, caption: str) -> None:
        found[name] = Drawing(svg=inline_svg(figure, name), alt=alt, caption=caption)

    with style():
        if diagnosis.slices:
            add(
                "map",
                map_figure(diagnosis.slices, unit, changed=both),
                f"Mean residual along each coordinate, {before_after}. {beyond_chance(diagnosis)}",
                "Mean residual in bins along each coordinate, with standard errors"
                + (": faint, the model with its own parameters refitted; dark, with the findings" if both else "")
                + ". Grey: what chance does anywhere on this map one time in a hundred. Above each panel: the largest "
                "mean in standard errors"
                + (
                    ", before → after; bold where one of them is beyond chance, red where the latter is."
                    if both
                    else "."
                )
                + _FOLLOWED * _wanders(diagnosis),
            )
        if diagnosis.steps:
            add(
                "steps",
                steps_figure(
                    diagnosis.steps,
                    diagnosis.fit.noise,
                    unit,
                    changed=changed(diagnosis),
                    came=any(one.was is not None for one in diagnosis.baseline.values()),
                ),
                f"Residual of every step in the order of time, {before_after}.",
                "Rms of the residual of every step, on a logarithmic scale. Shaded: steps that were held out, which "
                "chose nothing and fitted nothing." + _WEIGHED * _grows(diagnosis),
            )
        if diagnosis.traces:
            add(
                "traces",
                traces_figure(diagnosis.traces, unit, changed=both),
                f"Excerpts of steps: measured and predicted, {before_after}, and the residual.",
                _excerpts(diagnosis, both)
                + " Left: measured and predicted. Right: the residual, with means as lines; above it its rms."
                + _FOLLOWED * _wanders(diagnosis),
            )
    return found


def beyond_chance(diagnosis: Diagnosis) -> str:
    """Along which coordinates the residual is beyond chance, before and after."""
    before = _beyond([(one, significance(one, one.before)) for one in diagnosis.slices])
    after = _beyond([(one, significance(one, one.after)) for one in diagnosis.slices])
    if not predicts_otherwise(diagnosis):
        return f"With the model's own parameters refitted, beyond chance: {after}."
    return f"Beyond chance before: {before}. After: {after}."


def _beyond(largest: Sequence[tuple[Slice, float]]) -> str:
    names = [words.coordinate(of.coordinate) for of, size in largest if size > of.threshold]
    return ("every coordinate" if len(names) == len(largest) else words.listed(names)) if names else "nothing"


def _excerpts(diagnosis: Diagnosis, both: bool) -> str:
    spoilt = "where samples are spoilt, and " if any(one.spoilt.any() for one in diagnosis.traces) else ""
    return f"Excerpts {spoilt}where {'before and after differ most' if both else 'most is left'}."


def _wanders(diagnosis: Diagnosis) -> bool:
    return any(one.effect in WANDERING for one in diagnosis.findings)


def _grows(diagnosis: Diagnosis) -> bool:
    return any(one.effect == GROWING for one in diagnosis.findings)
