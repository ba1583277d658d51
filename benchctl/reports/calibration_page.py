"""The calibration report: one HTML page that says what was done, what was found, and how well it is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchctl.calibration.result import CalibrationResult, JointFit
from benchctl.recordings.model import Meta, StepInfo
from benchctl.reports import calibration_words as words
from benchctl.reports import setup_section, text, verdict
from benchctl.reports.calibration_drawings import drawings
from benchctl.reports.coefficient_tables import Budget, Coefficient, budget, joint_coefficients, stage_tables
from benchctl.reports.figures import PATH_LEVELS
from benchctl.reports.html import render, write_page
from benchctl.reports.run_errors import run_table


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherLaw:
    """A joint fit by another law, for comparison: by how much worse its BIC is, and its error on runs kept aside."""

    law: str
    difference: str
    error_percent: float | None
    rows: list[Coefficient]


def write_calibration_report(
    path: Path, result: CalibrationResult, meta: Meta, infos: Sequence[StepInfo], *, digest: str
) -> None:
    """Write the page, whole or not at all; `digest` is the recording's. Raises `UsageError` where the disk refuses."""
    write_page(path, calibration_page(result, meta, infos, digest=digest))


def calibration_page(result: CalibrationResult, meta: Meta, infos: Sequence[StepInfo], *, digest: str) -> str:
    """The page as text; the same input gives the same bytes."""
    best = result.joint[0] if result.joint else None
    formula = words.formula(best) if best else []
    output_unit = text.unit_text(result.output_unit)
    contributors = budget(best) if best else None
    return render(
        "calibration.html.j2",
        meta=meta,
        result=result,
        best=best,
        date=meta.provenance.get("started_utc", "")[:10],
        status=verdict.status_text(meta),
        cautions=verdict.cautions(meta, setup_section.cut_steps(infos)),
        simulated=verdict.is_simulated(meta),
        verdict=verdict.sentence(result),
        tiles=verdict.tiles(result),
        setup=setup_section.facts(meta, infos),
        instrument_rows=setup_section.instruments(meta),
        groups=setup_section.step_groups(infos, _uses(result)),
        drawings=drawings(result),
        output_unit=output_unit,
        scale_unit=text.scale_unit(output_unit),
        formula=formula,
        warm=any("ΔT" in line for line in formula),
        joint_rows=joint_coefficients(best) if best else [],
        others=[_other(joint, result) for joint in result.joint[1:]],
        stages=stage_tables(result),
        budget=contributors,
        budget_notes=_notes(contributors) if contributors else [],
        runs=run_table(result, infos),
        level_names={level: verdict.level_name(result, level) for level in PATH_LEVELS},
        remarks=words.remarks(result),
        conventions=words.conventions(result),
        provenance_rows=setup_section.provenance(meta, digest),
        again=words.again(meta),
    )


def _uses(result: CalibrationResult) -> dict[int, str]:
    """What became of each step, by index; one may have been cut into runs that were fitted and runs kept aside."""
    left = result.residuals
    fitted, aside = set(left.step[~left.verify].tolist()), set(left.step[left.verify].tolist())
    return {
        **dict.fromkeys(fitted, "fitted"),
        **dict.fromkeys(aside, "kept aside"),
        **dict.fromkeys(fitted & aside, "fitted; parts kept aside"),
    }


def _other(joint: JointFit, result: CalibrationResult) -> OtherLaw:
    return OtherLaw(
        law=joint.law,
        difference=text.number(joint.bic - result.best.bic, 3),
        error_percent=result.error_percent.get(f"joint_{joint.law}"),
        rows=joint_coefficients(joint),
    )


def _notes(of: Budget) -> list[tuple[str, str]]:
    return [(source.name, "; ".join(source.says)) for source in of.sources]
