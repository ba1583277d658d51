"""The confusion matrix of a proof as a picture: what was drawn, row by row, against what was stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from benchctl.atomic import whole_file
from benchctl.proof.confusion import Confusion
from benchctl.reports.figures import FAINT, GREY, INK, WIDTH_IN, style

_MARGIN_IN, _CELL_IN, _LABELS_IN = 0.4, 0.17, 1.5
_RIGHT = LinearSegmentedColormap.from_list("right", ["#d5ece4", "#00705a"])
_WRONG = LinearSegmentedColormap.from_list("wrong", ["#f7dccb", "#b84a00"])
_DPI = 170
_DARK = 0.55


def confusion_figure(arms: list[tuple[str, Confusion]]) -> Figure:
    """One matrix below the other, each with its title; none of them empty. Colours are shares of what was drawn."""
    heights = [_LABELS_IN + _CELL_IN * len(matrix.rows) + _MARGIN_IN for _, matrix in arms]
    figure = Figure(figsize=(WIDTH_IN, sum(heights)), layout="constrained")
    parts = figure.subplots(len(arms), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, (title, matrix) in zip(parts, arms, strict=True):
        _draw(axes, title, matrix)
    return figure


def write_confusion(path: Path, arms: list[tuple[str, Confusion]]) -> None:
    """Write the picture as PNG, whole or not at all; `UsageError` where the disk refuses."""
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
