"""Draw the sketches of effects: as a figure, as a file."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchctl.atomic import whole_file
from benchctl.explain.book import find
from benchctl.explain.pictures.gyro_effects import gyro_sketch
from benchctl.explain.pictures.part_effects import chamber_sketch, drive_sketch
from benchctl.explain.pictures.sketch import Panel, Sketch, SketchedCurve
from benchctl.reports.figures import GREY, INK, new_figure, style
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.registry import effects

_DOTS = " dots"
SUFFIXES = (".svg", ".png")
_COLOURS = {"off": GREY, "on": "#D55E00", "third": "#0072B2", "grey": GREY}
_INCHES_A_PANEL = 1.75
_MARGIN_IN = 0.55
_CROWDED, _MANY = 300, 3000
"""Number of points above which dots become small, and above which a curve is rasterized."""
_DPI = 170
_LETTERS = 120
"""Maximum number of characters in a line of the caption."""


def write_picture(term: str, path: Path) -> str:
    """Write the picture of a term atomically, as .svg or .png by the name's suffix; return its caption."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"--picture {path}: expected a name that ends in {' or '.join(SUFFIXES)}")
    sketch = _sketch(term)
    with style(), whole_file(path) as temporary:
        kind = path.suffix.lower()[1:]
        bare: dict[str, Any] = {"Date": None, "Creator": None} if kind == "svg" else {"Software": None}
        figure_of(sketch).savefig(temporary, format=kind, dpi=_DPI, metadata=bare)
    return sketch.caption


def figure_of(sketch: Sketch) -> Figure:
    """Draw a sketch as a figure: panels above each other, caption below; to be called within `style()`."""
    height = _MARGIN_IN + _INCHES_A_PANEL * sum(panel.share for panel in sketch.panels)
    figure = new_figure(height)
    shared = len({panel.x for panel in sketch.panels}) == 1
    ratios = [panel.share for panel in sketch.panels]
    every: list[Axes] = list(np.atleast_1d(figure.subplots(len(ratios), 1, sharex=shared, height_ratios=ratios)))
    for axes, panel in zip(every, sketch.panels, strict=True):
        _draw(axes, panel)
        if not shared or axes is every[-1]:
            axes.set_xlabel(panel.x)
    every[0].set_title(sketch.title)
    figure.align_ylabels(every)
    caption = textwrap.fill(sketch.caption, _LETTERS)
    figure.supxlabel(caption, fontsize=7, color=INK, x=0.01, ha="left", multialignment="left")
    return figure


def _sketch(term: str) -> Sketch:
    found = find(term)
    for entry in found:
        if entry.drawing:
            return effect_sketch(entry.drawing)
    raise UsageError(f"explain {found[0].name}: there is no picture of it; leave out --picture")


def _draw(axes: Axes, panel: Panel) -> None:
    if panel.zero:
        axes.axhline(0.0, color=INK, linewidth=0.5)
    for curve in panel.curves:
        _plot(axes, curve)
    axes.set_ylabel(panel.y)
    if panel.logarithmic:
        axes.set_xscale("log")
        axes.set_yscale("log")
    axes.margins(x=0.01)
    if any(curve.label for curve in panel.curves):
        crowded = any(curve.x.size > _CROWDED and curve.look.endswith(_DOTS) for curve in panel.curves)
        axes.legend(loc="best", markerscale=3.0 if crowded else 1.0, frameon=True, framealpha=0.8, edgecolor="none")


def _plot(axes: Axes, curve: SketchedCurve) -> None:
    colour, dotted = curve.look.removesuffix(_DOTS), curve.look.endswith(_DOTS)
    axes.plot(
        curve.x,
        curve.y,
        color=_COLOURS[colour],
        label=curve.label or None,
        linestyle="none" if dotted else "--" if colour == "off" else "-",
        linewidth=0.8 if colour == "grey" else 1.2,
        marker="o" if dotted else None,
        markersize=(0.9 if curve.x.size > _CROWDED else 3.2) if dotted else 0,
        markeredgewidth=0,
        rasterized=curve.x.size > _MANY,
    )


def effect_sketch(identifier: str) -> Sketch:
    """Return the sketch of an effect of any part of the bench."""
    if identifier in effects():
        return gyro_sketch(effects()[identifier])
    if identifier in drive_effects():
        return drive_sketch(drive_effects()[identifier])
    return chamber_sketch(chamber_effects()[identifier])
