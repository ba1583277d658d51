"""What all figures share: size, colours, style, and how a figure becomes part of a page.

Figures are made with matplotlib's objects alone (no pyplot, no global state) and become inline SVG whose bytes depend
on nothing but the data. Importing this module imports matplotlib: the command line does so only when it draws.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchctl_instruments.arrays import FloatArray

WIDTH_IN = 7.2
"""Width of a figure: the text block of an A4 page."""

PATH_LEVELS: Mapping[str, str] = {
    "raw": "raw",
    "stage_1": "stage 1",
    "stage_2": "stage 2",
    "joint": "joint fit",
}
"""The levels that a report follows, in the order in which the error goes down, by their short names."""

LEVEL_COLOURS: Mapping[str, str] = {"raw": "#D55E00", "stage_1": "#E69F00", "stage_2": "#009E73", "joint": "#0072B2"}
"""One colour a level, everywhere in a report (Okabe and Ito's palette, told apart by colour-blind readers)."""

LEVEL_MARKERS: Mapping[str, str] = {"raw": "o", "stage_1": "s", "stage_2": "^", "joint": "D"}
"""The levels once more, for a reader without colours."""

INK, GREY, FAINT = "#222222", "#6b6b6b", "#b9c0c7"

_MOST_VECTOR_POINTS = 400
_STYLE: dict[Any, Any] = {  # of any key: its type lists the settings of one version of matplotlib
    "font.family": "DejaVu Sans",
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.titlelocation": "left",
    "axes.labelsize": 7.5,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.5,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "svg.fonttype": "path",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """A figure in a page: its SVG, what it shows in one sentence for who cannot see it, and the caption below."""

    svg: str
    alt: str
    caption: str


def style() -> AbstractContextManager[None]:
    """The style of all figures; to be active while they are made and while they are written."""
    return mpl.rc_context(_STYLE)


def new_figure(height_in: float) -> Figure:
    """An empty figure of the page's width."""
    return Figure(figsize=(WIDTH_IN, height_in), layout="constrained")


def inline_svg(figure: Figure, name: str) -> str:
    """A figure as SVG to be put into HTML: no prolog, no dates, no foreign addresses; `name` makes its ids unique."""
    stream = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": name}):
        figure.savefig(
            stream, format="svg", dpi=170, metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
        )
    svg = stream.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\s+xmlns(:xlink)?="[^"]*"', "", svg, count=2)
    svg = svg.replace("xlink:href=", "href=")
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'href="#', f'href="#{name}-', svg)
    svg = svg.replace("url(#", f"url(#{name}-")
    # Its size is the page's business: the view box keeps the proportions.
    return re.sub(r'<svg width="[^"]*" height="[^"]*"', "<svg", svg, count=1)


def dots(axes: Axes, x: FloatArray, y: FloatArray, colour: str, *, size: float = 1.6) -> None:
    """Many small points; drawn as pixels inside the SVG where they are many."""
    axes.plot(
        x,
        y,
        linestyle="none",
        marker=".",
        markersize=size,
        markeredgewidth=0,
        color=colour,
        rasterized=x.size > _MOST_VECTOR_POINTS,
    )


def level_names(keys: Sequence[str]) -> list[str]:
    """Those levels of the path that there are, in its order."""
    return [name for name in PATH_LEVELS if name in keys]
