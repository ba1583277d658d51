"""The report on a diagnosis: one HTML page for somebody who was not there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import tomli_w

from benchctl.diagnosis.result import Diagnosis
from benchctl.model_file import with_discovered
from benchctl.recordings.model import Meta, StepInfo
from benchctl.reports import diagnosis_tables as tables
from benchctl.reports import diagnosis_words as words
from benchctl.reports import setup_section, verdict
from benchctl.reports.diagnosis_drawings import beyond_chance, drawings
from benchctl.reports.diagnosis_headline import changed, chip, headline, moved, title
from benchctl.reports.diagnosis_lines import next_command
from benchctl.reports.html import render, write_page


def write_diagnosis_report(
    path: Path, diagnosis: Diagnosis, meta: Meta, infos: Sequence[StepInfo], *, digest: str, unit: str = "V"
) -> None:
    """Write the page, whole or not at all; `digest` is the recording's, `unit` that of the diagnosed quantity.

    Raises `UsageError` where the disk refuses.
    """
    write_page(path, diagnosis_page(diagnosis, meta, infos, digest=digest, unit=unit))


def diagnosis_page(diagnosis: Diagnosis, meta: Meta, infos: Sequence[StepInfo], *, digest: str, unit: str = "V") -> str:
    """The page as text; the same input gives the same bytes."""
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
    """Level, name, value and remark of each size that stands at the head of the page."""
    fit = diagnosis.fit
    yield "", "noise", words.size(fit.noise, unit), "of the recording itself, rms"
    named = [("raw", "before", fit.heldout_before), ("joint", "after", fit.heldout_after)]
    for level, name, rms in named if changed(diagnosis) else [("joint", "what the model leaves", fit.heldout_after)]:
        yield level, name, words.size(rms, unit), words.times_noise(rms, fit.noise)
