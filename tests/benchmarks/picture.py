"""All ratios in one picture: a bar each, from its goal to how many times better or worse than it the figure is."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter

from benchctl.atomic import whole_file
from benchctl.reports.figures import INK
from benchctl.reports.text import number
from tests.benchmarks.comparison import Comparison
from tests.benchmarks.machine import Conditions
from tests.benchmarks.table import goal_of

# told apart without colours too: by the side of the goal that they lie on, and by the hatching
REACHED, MISSED = "#0072B2", "#D55E00"
_WIDTH_IN, _ROW_IN, _REST_IN = 9.0, 0.55, 1.7
_LABEL_WIDTH, _NOTE_WIDTH = 50, 130
_MOST = 1e3


def write_picture(found: Sequence[Comparison], conditions: Conditions, path: Path) -> None:
    """Write it as PNG, whole or not at all."""
    figure = drawn(found, conditions)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=150)


def drawn(found: Sequence[Comparison], conditions: Conditions) -> Figure:
    """The picture of some figures, the first one at the top."""
    figure = Figure(figsize=(_WIDTH_IN, _REST_IN + _ROW_IN * len(found)), layout="constrained")
    axes = figure.subplots()
    for place, one in enumerate(found):
        better = times_better(one)
        look = {"color": REACHED} if one.reached else {"facecolor": MISSED, "hatch": "///", "edgecolor": "white"}
        axes.barh(place, better - 1.0, left=1.0, height=0.6, **look)
        axes.annotate(
            f"{number(one.ratio)} (goal {goal_of(one)}{'' if one.reached else ', missed'})",
            (max(better, 1.0), place),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    reach = max([2.0, *(max(times_better(one), 1.0 / times_better(one)) for one in found)])
    worst = min([1.0, *(times_better(one) for one in found)])
    axes.set_xlim(worst / 1.5, reach**1.7 * 1.2)  # beyond the longest bars there is room for their figures
    axes.axvline(1.0, color=INK, linewidth=1.2)
    axes.set_yticks(range(len(found)), [_label(one) for one in found], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("times better than the goal (the line)")
    axes.set_title("Ours over theirs", loc="left", fontsize=10)
    legend = [
        Patch(color=REACHED, label="goal reached"),
        Patch(facecolor=MISSED, hatch="///", edgecolor="white", label="goal missed"),
    ]
    figure.legend(handles=legend, loc="outside upper right", ncols=2, fontsize=8, frameon=False)
    note = f"{conditions.machine}; {conditions.date}; {conditions.versions}"
    figure.supxlabel(textwrap.fill(note, _NOTE_WIDTH, break_on_hyphens=False), fontsize=6.5)
    return figure


def times_better(one: Comparison) -> float:
    """How many times better than its goal a ratio is; below 1 where it misses it. What is nothing ends at the edge."""
    share = max(one.ratio / one.bound, 1.0 / _MOST)
    return min(1.0 / share if one.sense == "<=" else share, _MOST)


def _label(one: Comparison) -> str:
    values = f"{number(one.value)} against {number(one.against_value)} {one.unit} ({one.against})"
    return "\n".join(textwrap.fill(part, _LABEL_WIDTH) for part in (one.name, values))
