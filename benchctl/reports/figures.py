"""Size, colours and style of all figures, and their conversion to inline SVG.

Figures are made with matplotlib's objects alone (no pyplot, no global state). The bytes of the inline SVG depend only
on the data. Importing this module imports matplotlib: the command line does so only when it draws.
"""

from __future__ import annotations

import io
import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from benchctl_instruments.arrays import FloatArray

WIDTH_IN = 7.2
"""Width of a figure: the text block of an A4 page."""

PATH_LEVELS: Mapping[str, str] = {
    "raw": "raw",
    "stage_1": "stage 1",
    "stage_2": "stage 2",
    "joint": "joint fit",
}
"""The levels of the calibration in the order of decreasing error, with their short names."""

LEVEL_COLOURS: Mapping[str, str] = {"raw": "#D55E00", "stage_1": "#E69F00", "stage_2": "#009E73", "joint": "#0072B2"}
"""One colour per level in all reports (Okabe and Ito's palette, distinguishable by colour-blind readers)."""

LEVEL_MARKERS: Mapping[str, str] = {"raw": "o", "stage_1": "s", "stage_2": "^", "joint": "D"}
"""One marker per level, so that the levels are distinguishable without colours."""

INK, GREY, FAINT = "#222222", "#6b6b6b", "#b9c0c7"

_MOST_VECTOR_POINTS = 400
_STYLE: dict[Any, Any] = {  # keys are Any: matplotlib's type lists the settings of one version only
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
    """A figure in a page: its SVG, the alternative text in one sentence, and the caption below it."""

    svg: str
    alt: str
    caption: str


def style() -> AbstractContextManager[None]:
    """Return the style context of all figures, to be active while they are made and written."""
    return mpl.rc_context(_STYLE)


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """Return an empty figure, of the page's width if no other is given."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


def inline_svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG for HTML: no prolog, no dates, no external addresses; `name` makes its ids unique."""
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
    # The page sets the size; the view box keeps the proportions.
    return re.sub(r'<svg width="[^"]*" height="[^"]*"', "<svg", svg, count=1)


def embedded(png: bytes) -> str:
    """Return an image as SVG for HTML."""
    with Image.open(io.BytesIO(png)) as image:
        width, height = image.size
    content = b64encode(png).decode()
    href = f"data:image/png;base64,{content}"
    return f'<svg viewBox="0 0 {width} {height}"><image width="{width}" height="{height}" href="{href}"/></svg>'


def dots(axes: Axes, x: FloatArray, y: FloatArray, colour: str, *, size: float = 1.6) -> None:
    """Plot many small points; they are rasterized inside the SVG above `_MOST_VECTOR_POINTS`."""
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
    """Return the levels that are present in `keys`, in the order of `PATH_LEVELS`."""
    return [name for name in PATH_LEVELS if name in keys]
