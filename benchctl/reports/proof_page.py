"""The report on a proof: the table by class, the confusion matrix, and every trial that was not right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from benchctl.proof.classes import CLASSES
from benchctl.proof.confusion import Confusion
from benchctl.proof.summary import Summary
from benchctl.proof.trial import Trial
from benchctl.reports.figures import Drawing, inline_svg, style
from benchctl.reports.html import render, write_page
from benchctl.reports.proof_figures import confusion_figure, write_confusion
from benchctl.reports.proof_lines import lines, percent

REPORT, PICTURE = "proof.html", "confusion.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongTrial:
    """A trial that was not right, in words."""

    index: int
    kind: str
    drawn: str
    said: str


def write_proof_report(folder: Path, summary: Summary) -> Mapping[str, Path]:
    """Write the page and, where anything was answered, the picture; where they are, by what they are.

    Raises `UsageError` where the disk refuses.
    """
    written = {"report": folder / REPORT}
    if arms := _arms(summary):
        written["picture"] = folder / PICTURE
        write_confusion(written["picture"], arms)
    write_page(written["report"], proof_page(summary))
    return written


def proof_page(summary: Summary) -> str:
    """The page as text; the same trials give the same bytes, their times apart."""
    return render(
        "proof.html.j2",
        summary=summary,
        classes=CLASSES,
        percent=percent,
        drawing=_drawing(_arms(summary)),
        lines=[line for line in lines(summary) if ":" in line],
        wrong=[_wrong(trial) for trial in summary.trials if not trial.physics.right],
    )


def _arms(summary: Summary) -> list[tuple[str, Confusion]]:
    """The arms that answered, with their matrices."""
    arms = [("Diagnosis", summary.confusion), ("Sparse regression", summary.generic_confusion)]
    return [(name, matrix) for name, matrix in arms if matrix is not None and matrix.rows]


def _drawing(arms: list[tuple[str, Confusion]]) -> Drawing | None:
    if not arms:
        return None
    with style():
        svg = inline_svg(confusion_figure(arms), "confusion")
    return Drawing(
        svg=svg,
        alt="Matrix of what was drawn against what was stated",
        caption="What was drawn (rows) against what was stated (columns), in trials of all classes. Green is right.",
    )


def _wrong(trial: Trial) -> WrongTrial:
    drawn = "; ".join(
        f"{name} ({', '.join(f'{key} = {value:.4g}' for key, value in values.items())})"
        for name, values in trial.truth["effects"].items()
    )
    found = trial.physics
    said = found.error or "; ".join(
        part
        for part in (
            found.verdict,
            ", ".join(found.stated),
            f"unexplained along {', '.join(found.coordinates) or 'nothing'}" if found.unexplained else "",
        )
        if part
    )
    return WrongTrial(index=trial.index, kind=CLASSES[trial.kind].says, drawn=drawn or "nothing", said=said)
