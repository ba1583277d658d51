"""Draw sketches: as a figure, as SVG for a page, as a file."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchctl.atomic import whole_file
from benchctl.explain.book import find
from benchctl.explain.glossary import Entry
from benchctl.explain.pictures import made_noise, made_terms, made_tests
from benchctl.explain.pictures.gyro_effects import gyro_sketch
from benchctl.explain.pictures.part_effects import chamber_sketch, drive_sketch
from benchctl.explain.pictures.sketch import Panel, Sketch, SketchedCurve
from benchctl.reports.figures import FAINT, GREY, INK, inline_svg, new_figure, style
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.registry import effects

_DOTS = " dots"
SUFFIXES = (".svg", ".png")
_COLOURS = {"off": GREY, "on": "#D55E00", "third": "#0072B2", "grey": GREY, "faint": FAINT}
_BANDS = {"good": "#009E73", "open": "#E69F00", "bad": "#D55E00"}
_INCHES_A_PANEL = 1.75
_MARGIN_IN = 0.55
_CROWDED, _MANY = 300, 3000
"""Number of points above which dots become small, and above which a curve is rasterized."""
_DPI = 170
_LETTERS = 120
"""Maximum number of characters in a line of the caption."""


def picture(term: str) -> str:
    """Return the picture of a term as inline SVG.

    Raises
    ------
    UsageError
        If there is no such term, or it has no picture.
    """
    sketch = _sketch(term)
    with style():
        return inline_svg(figure_of(sketch), "explain-" + re.sub(r"\W+", "-", sketch.title))


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
            return sketch_of(entry)
    raise UsageError(f"explain {found[0].name}: there is no picture of it; leave out --picture")


def _draw(axes: Axes, panel: Panel) -> None:
    if panel.zero:
        axes.axhline(0.0, color=INK, linewidth=0.5)
    for band in panel.bands:
        fill = axes.axhspan if band.across else axes.axvspan
        fill(band.low, band.high, color=_BANDS[band.look], alpha=0.16, linewidth=0, label=band.label or None)
    for curve in panel.curves:
        _plot(axes, curve)
    axes.set_ylabel(panel.y)
    if panel.logarithmic:
        axes.set_xscale("log")
    if panel.logarithmic == "xy":
        axes.set_yscale("log")
    axes.margins(x=0.01)
    for x, y, label in panel.marks:
        _mark(axes, x, y, label)
    if any(curve.label for curve in panel.curves) or any(band.label for band in panel.bands):
        crowded = any(curve.x.size > _CROWDED and curve.look.endswith(_DOTS) for curve in panel.curves)
        axes.legend(loc="best", markerscale=3.0 if crowded else 1.0, frameon=True, framealpha=0.8, edgecolor="none")


def _mark(axes: Axes, x: float, y: float, label: str) -> None:
    """Write a label at a point, on the side with more space."""
    axes.autoscale_view()
    across = axes.transAxes.inverted().transform(axes.transData.transform((x, y)))[0]
    side, towards = (5, "left") if across < 0.5 else (-5, "right")
    axes.annotate(label, (x, y), xytext=(side, 2), textcoords="offset points", fontsize=7, color=INK, ha=towards)


def _plot(axes: Axes, curve: SketchedCurve) -> None:
    colour, dotted = curve.look.removesuffix(_DOTS), curve.look.endswith(_DOTS)
    axes.plot(
        curve.x,
        curve.y,
        color=_COLOURS[colour],
        label=curve.label or None,
        linestyle="none" if dotted else "--" if colour == "off" else "-",
        linewidth=0.8 if colour in ("grey", "faint") else 1.2,
        marker="o" if dotted else None,
        markersize=(0.9 if curve.x.size > _CROWDED else 3.2) if dotted else 0,
        markeredgewidth=0,
        rasterized=curve.x.size > _MANY,
    )


MADE: Mapping[str, Callable[[], Sketch]] = {
    made.__name__: made
    for made in (
        made_tests.scale_factor,
        made_tests.nonlinearity,
        made_tests.input_range,
        made_tests.turn_ons,
        made_tests.hysteresis_rate,
        made_tests.hysteresis_bias,
        made_tests.threshold,
        made_tests.misalignment,
        made_noise.bias,
        made_noise.bias_stability,
        made_noise.whitening,
        made_terms.convention,
        made_terms.argument,
        made_terms.error_path,
        made_terms.coverage,
        made_terms.guard_band,
        made_terms.e_n,
        made_terms.control_chart,
        made_terms.soak,
        made_terms.bandwidth,
        made_terms.warm_up_time,
    )
}
"""The pictures other than those of effects, by their names in `terms/*.toml`; `allan:N` and the like are separate."""


def sketch_of(entry: Entry) -> Sketch:
    """Return the sketch of an entry that has a picture."""
    kind, _, name = entry.drawing.partition(":")
    if kind == "effect":
        return effect_sketch(name)
    return made_noise.allan(name) if kind == "allan" else MADE[kind]()


def effect_sketch(identifier: str) -> Sketch:
    """Return the sketch of an effect of any part of the bench."""
    if identifier in effects():
        return gyro_sketch(effects()[identifier])
    if identifier in drive_effects():
        return drive_sketch(drive_effects()[identifier])
    return chamber_sketch(chamber_effects()[identifier])
