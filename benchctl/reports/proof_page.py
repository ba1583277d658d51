"""The report on a proof: the table by class, the confusion matrices, and all trials with a wrong answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from benchctl.atomic import whole_file
from benchctl.proof.classes import CLASSES
from benchctl.proof.confusion import Confusion
from benchctl.proof.summary import ArmFigures, ClassRow, Share, Summary
from benchctl.proof.trial import Trial
from benchctl.reports.figures import FAINT, GREY, INK, WIDTH_IN, Drawing, inline_svg, style
from benchctl.reports.html import render, write_page


def lines(summary: Summary) -> Iterator[str]:
    """Yield the table by class, then the figures over all trials."""
    compared = summary.generic is not None
    head = f"{'':<30} {'right':>12} {'verdict':>12}"
    yield head + (f" {'sparse regr.':>14}" if compared else "")
    for row in summary.classes:
        yield _class_line(row)
    yield ""
    yield from _figures("diagnosis", summary.physics)
    if summary.generic is not None:
        yield from _figures("sparse regression", summary.generic)


def lines_on(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield the results of trials on a real recording, by effect and in total; `values` is the data for `--json`."""
    yield f"untouched: {', '.join(values['untouched']) or 'nothing found'}"
    yield f"{'':<34} {'named':>10} {'smallest named':>16} {'largest missed':>16}   (rms / untouched residual)"
    for row in values["effects"]:
        sizes = ["" if row[name] is None else f"{row[name]:.2f}" for name in ("smallest_named", "largest_missed")]
        named = f"{row['named']:>4} of {row['trials']:<3}"
        yield f"{row['effect'].replace('_', ' '):<34} {named} {sizes[0]:>16} {sizes[1]:>16}"
    yield (
        f"named {percent(Share(count=values['named'], of=values['trials']))}, {values['as_alternative']} of them as an"
        f" alternative of another effect; its own findings lost in {values['lost']} trials, something made up in"
        f" {values['made_up']}"
    )


def percent(share: Share) -> str:
    """Return a share as text: `29 of 30 (97 %)`."""
    return f"{share} ({100 * share.value:.0f} %)" if share.value is not None else "none"


def _class_line(row: ClassRow) -> str:
    line = f"{CLASSES[row.kind].title:<30} {row.right!s:>12} {row.verdict!s:>12}"
    return line if row.generic is None else f"{line} {row.generic!s:>14}"


def _figures(name: str, arm: ArmFigures) -> Iterator[str]:
    yield f"{name}: named {percent(arm.named)} of what was drawn, {arm.made_up} made up"
    yield f"  nothing missing, yet something named: {percent(arm.false_alarms)}"
    if arm.inside_ci95.of:
        yield (
            f"  parameters within 25 % of the truth: {percent(arm.near)}; within 10 %: {percent(arm.nearer)}; "
            f"inside their 95 % interval: {percent(arm.inside_ci95)}"
        )
    if arm.held_out is not None:
        yield f"  held-out residual over the noise: {arm.held_out:.3f} (median)"
    if arm.seconds is not None:
        memory = "" if arm.peak_bytes is None else f", at most {arm.peak_bytes / 2**20:.0f} MiB"
        yield f"  time for one answer: {arm.seconds:.1f} s (median){memory}"
    if arm.silent:
        yield f"  no answer in {arm.silent} trials"


REPORT, PICTURE = "proof.html", "confusion.png"


def write_proof_report(folder: Path, summary: Summary) -> Mapping[str, Path]:
    """Write the page and, if there are answers, the picture; return their paths by kind.

    Raises `UsageError` if a file cannot be written.
    """
    written = {"report": folder / REPORT}
    if arms := _arms(summary):
        written["picture"] = folder / PICTURE
        write_confusion(written["picture"], arms)
    write_page(written["report"], proof_page(summary))
    return written


def proof_page(summary: Summary) -> str:
    """Return the page as text. The same trials give the same bytes, except for times."""
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
    """Return the methods that gave answers, with their confusion matrices."""
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


def _wrong(trial: Trial) -> dict[str, object]:
    drawn = "; ".join(
        f"{name} ({', '.join(f'{key} = {value:.4g}' for key, value in values.items())})"
        for name, values in trial.truth["effects"].items()
    )
    found = trial.physics
    answer = found.error or "; ".join(
        part
        for part in (
            found.verdict,
            ", ".join(found.stated),
            f"unexplained along {', '.join(found.coordinates) or 'nothing'}" if found.unexplained else "",
        )
        if part
    )
    return {"index": trial.index, "kind": CLASSES[trial.kind].title, "drawn": drawn or "nothing", "said": answer}


_MARGIN_IN, _CELL_IN, _LABELS_IN = 0.4, 0.17, 1.5
_RIGHT = LinearSegmentedColormap.from_list("right", ["#d5ece4", "#00705a"])
_WRONG = LinearSegmentedColormap.from_list("wrong", ["#f7dccb", "#b84a00"])
_DPI = 170
_DARK = 0.55


def confusion_figure(arms: list[tuple[str, Confusion]]) -> Figure:
    """Draw the matrices, none of them empty, below each other with titles. Colours are shares of what was drawn."""
    heights = [_LABELS_IN + _CELL_IN * len(matrix.rows) + _MARGIN_IN for _, matrix in arms]
    figure = Figure(figsize=(WIDTH_IN, sum(heights)), layout="constrained")
    parts = figure.subplots(len(arms), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, (title, matrix) in zip(parts, arms, strict=True):
        _draw(axes, title, matrix)
    return figure


def write_confusion(path: Path, arms: list[tuple[str, Confusion]]) -> None:
    """Write the picture as PNG, atomically; raises `UsageError` if it cannot be written."""
    with style(), whole_file(path) as temporary:
        confusion_figure(arms).savefig(temporary, format="png", dpi=_DPI, metadata={"Software": None})


def _draw(axes: Axes, title: str, matrix: Confusion) -> None:
    axes.set_title(title)
    axes.grid(visible=False)
    columns = matrix.columns
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(len(matrix.rows) - 0.5, -0.5)
    axes.set_xticks(range(len(columns)), [_words(name) for name in columns], rotation=90)
    axes.set_yticks(range(len(matrix.rows)), [_words(name) for name in matrix.rows])
    axes.set_xlabel("stated")
    axes.set_ylabel("drawn")
    axes.hlines(np.arange(-0.5, len(matrix.rows)), -0.5, len(columns) - 0.5, color=FAINT, linewidth=0.3)
    axes.vlines(np.arange(-0.5, len(columns)), -0.5, len(matrix.rows) - 0.5, color=FAINT, linewidth=0.3)
    totals = np.maximum(matrix.counts.sum(axis=1), 1)
    for row, column in zip(*np.nonzero(matrix.counts), strict=True):
        count = int(matrix.counts[row, column])
        share = count / totals[row]
        colours = _RIGHT if matrix.is_right(int(row), int(column)) else _WRONG
        axes.fill_between([column - 0.5, column + 0.5], row - 0.5, row + 0.5, color=colours(share), linewidth=0)
        ink = "white" if share > _DARK else INK
        axes.text(column, row, str(count), ha="center", va="center", fontsize=6, color=ink)
    axes.tick_params(length=0, colors=GREY)


def _words(name: str) -> str:
    return name.replace("_", " ")
