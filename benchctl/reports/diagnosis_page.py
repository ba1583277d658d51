"""The report on a diagnosis: one HTML page for somebody who was not there."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import tomli_w

from benchctl.diagnosis.result import Diagnosis
from benchctl.recordings.model import Meta, StepInfo
from benchctl.reports import diagnosis_tables as tables
from benchctl.reports import diagnosis_words as words
from benchctl.reports import setup_section, text, verdict
from benchctl.reports.diagnosis_drawings import beyond_chance, drawings
from benchctl.reports.diagnosis_lines import next_command
from benchctl.reports.html import render, write_page
from instruments.physics.effects.registry import effects


def write_diagnosis_report(
    path: Path, diagnosis: Diagnosis, meta: Meta, infos: Sequence[StepInfo], *, digest: str, unit: str = "V"
) -> None:
    """Write the page, whole or not at all; `digest` is the recording's, `unit` that of the diagnosed quantity.

    Raises `UsageError` where the disk refuses.
    """
    write_page(path, diagnosis_page(diagnosis, meta, infos, digest=digest, unit=unit))


def diagnosis_page(diagnosis: Diagnosis, meta: Meta, infos: Sequence[StepInfo], *, digest: str, unit: str = "V") -> str:
    """The page as text; the same input gives the same bytes."""
    unit = text.unit_text(unit)
    looked_for = [tables.not_found_row(one) for one in diagnosis.not_found]
    fit = diagnosis.fit
    return render(
        "diagnosis.html.j2",
        meta=meta,
        diagnosis=diagnosis,
        date=meta.provenance.get("started_utc", "")[:10],
        status=verdict.status_text(meta),
        cautions=verdict.cautions(meta, setup_section.cut_steps(infos)),
        simulated=verdict.is_simulated(meta),
        verdict=words.VERDICTS[diagnosis.verdict],
        tiles=[
            ("", "noise", words.size(fit.noise_v, unit), "of the recording itself, rms"),
            (
                "raw",
                "before",
                words.size(fit.heldout_before_v, unit),
                words.times_noise(fit.heldout_before_v, fit.noise_v),
            ),
            (
                "joint",
                "after",
                words.size(fit.heldout_after_v, unit),
                words.times_noise(fit.heldout_after_v, fit.noise_v),
            ),
        ],
        findings=[tables.finding_section(finding, effects(), diagnosis.threshold) for finding in diagnosis.findings],
        drawings=drawings(diagnosis, unit),
        beyond=beyond_chance(diagnosis),
        unexplained_where=[words.coordinate(name) for name in diagnosis.unexplained.coordinates],
        separates=[tables.title(name) for name in diagnosis.next_experiment.separates],
        next_command=next_command(diagnosis),
        looked_for=[row for row in looked_for if row.smallest],
        not_seen=[row for row in looked_for if not row.smallest],
        fit_rows=tables.fit_rows(diagnosis, unit),
        baseline=tables.baseline_rows(diagnosis),
        held_out=sum(step.heldout for step in diagnosis.steps),
        model_toml=tomli_w.dumps(dict(diagnosis.model)) if diagnosis.model else "",
        setup=setup_section.facts(meta, infos),
        provenance_rows=setup_section.provenance(meta, digest),
    )
