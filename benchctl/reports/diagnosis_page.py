"""The diagnosis report: one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import tomli_w
from matplotlib.figure import Figure

from benchctl.diagnosis.result import Diagnosis, Slice
from benchctl.model_file import with_discovered
from benchctl.recordings.model import Meta, StepInfo
from benchctl.reports import diagnosis_tables as tables
from benchctl.reports import diagnosis_words as words
from benchctl.reports import setup_section, verdict
from benchctl.reports.diagnosis_tables import next_command
from benchctl.reports.diagnosis_words import (
    GROWING,
    WANDERING,
    changed,
    chip,
    headline,
    moved,
    predicts_otherwise,
    title,
)
from benchctl.reports.figures import Drawing, inline_svg, style
from benchctl.reports.html import render
from benchctl.reports.mismatch_figures import curve_figure, map_figure, significance, steps_figure, traces_figure

_FOLLOWED = " After, the wandering bias is followed from sample to sample."
_WEIGHED = " After, each sample is weighed by the noise that its rate brings, and should come to the noise at rest."


def drawings(diagnosis: Diagnosis, unit: str) -> Mapping[str, Drawing]:
    """Draw the figures for which there are data, by name: map, steps, traces, structure-1 and so on."""
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
        for number, model in enumerate(diagnosis.unexplained.models, start=1):
            if model.curve is not None:
                add(
                    f"structure-{number}",
                    curve_figure(model, unit),
                    f"The fitted function, and what the held-out steps require. {model.says}",
                    "Means of held-out steps in bins of the coordinate, with standard errors. Above: what the residual "
                    "without the structure asks of it; the line is the fitted function, shaded its 95 % interval. "
                    "Below: what the structure leaves.",
                )
    return found


def beyond_chance(diagnosis: Diagnosis) -> str:
    """Return a sentence naming the coordinates along which the residual exceeds the chance level, before and after."""
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


def diagnosis_page(diagnosis: Diagnosis, meta: Meta, infos: Sequence[StepInfo], *, digest: str, unit: str = "V") -> str:
    """Return the page as text. The same input gives the same bytes."""
    unit = words.unit(unit)
    known = tables.known_effects()
    return render(
        "diagnosis.html.j2",
        meta=meta,
        diagnosis=diagnosis,
        date=meta.provenance.get("started_utc", "")[:10],
        status=verdict.status_text(meta),
        cautions=verdict.cautions(meta, setup_section.cut_steps(infos)),
        simulated=verdict.is_simulated(meta),
        verdict=chip(diagnosis),
        headline=words.prose(headline(diagnosis)),
        tiles=list(_tiles(diagnosis, unit)),
        changed=changed(diagnosis),
        findings=[tables.finding_section(finding, known, diagnosis.threshold, unit) for finding in diagnosis.findings],
        moved=tables.baseline_rows(moved(diagnosis)),
        drawings=drawings(diagnosis, unit),
        beyond=beyond_chance(diagnosis),
        unexplained_where=[words.coordinate(name) for name in diagnosis.unexplained.coordinates],
        structures=[tables.structure_section(one) for one in diagnosis.unexplained.models],
        unexplained_says=words.prose(diagnosis.unexplained.says),
        next_says=words.prose(diagnosis.next_experiment.says),
        notes=[words.prose(note) for note in diagnosis.notes],
        separates=[title(name) for name in diagnosis.next_experiment.separates],
        next_command=next_command(diagnosis),
        looked_for=[tables.not_found_row(one) for one in diagnosis.not_found],
        fit_rows=tables.fit_rows(diagnosis, unit),
        baseline=tables.baseline_rows(diagnosis.baseline),
        held_out=sum(step.heldout for step in diagnosis.steps),
        model_toml=tomli_w.dumps(with_discovered(diagnosis.model)) if diagnosis.model else "",
        setup=setup_section.facts(meta, infos),
        provenance_rows=setup_section.provenance(meta, digest),
    )


def _tiles(diagnosis: Diagnosis, unit: str) -> Iterator[tuple[str, str, str, str]]:
    """Yield level, name, value and remark of each rms value at the top of the page."""
    fit = diagnosis.fit
    yield "", "noise", words.size(fit.noise, unit), "of the recording itself, rms"
    named = [("raw", "before", fit.heldout_before), ("joint", "after", fit.heldout_after)]
    for level, name, rms in named if changed(diagnosis) else [("joint", "what the model leaves", fit.heldout_after)]:
        yield level, name, words.size(rms, unit), words.times_noise(rms, fit.noise)
