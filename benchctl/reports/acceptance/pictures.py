"""The picture of a test: what it saw over its axis, and below it what its law leaves."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from benchctl.metrology.result import Picture, Trace
from benchctl.reports.acceptance import document
from benchctl.reports.acceptance.catalogue import Catalogue
from benchctl.reports.figures import INK, Drawing, dots, inline_svg, new_figure, style

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_MARKERS = ("o", "s", "^", "D", "v", "P")
_DASHES = ("-", "--", "-.", ":")
_HEIGHT_IN, _HEIGHT_WITH_LEFT_IN = 2.3, 3.1
_MANY = 120
"""Dots, beyond which each becomes small."""
_DPI = 250
_LONGEST_UPRIGHT, _LONGEST_BELOW = 26, 14


def drawn(picture: Picture, name: str, words: Catalogue) -> document.Picture:
    """The picture for page and PDF, its words in the catalogue's language; `name` makes its ids unique."""
    x, y = words.word(picture.x), words.word(picture.y)
    caption = words.label("picture", x=x, y=y)
    if picture.left:
        caption = words.label("picture_left", x=x, y=y, left=words.word(picture.left[0].label))
    with style():
        figure = picture_figure(picture, words)
        svg = inline_svg(figure, name)
        figure.set_layout_engine("none")  # it has found its places once
        pixels = io.BytesIO()
        figure.savefig(pixels, format="png", dpi=_DPI, metadata={"Software": None})
    return document.Picture(drawing=Drawing(svg=svg, alt=caption, caption=caption), png=pixels.getvalue())


def picture_figure(picture: Picture, words: Catalogue) -> Figure:
    """The traces over the picture's axis; both axes logarithmic where asked for, y only where all of it is positive."""
    figure = new_figure(_HEIGHT_WITH_LEFT_IN if picture.left else _HEIGHT_IN)
    axes: list[Axes] = list(
        np.atleast_1d(figure.subplots(2, 1, sharex=True, height_ratios=(5, 3))) if picture.left else [figure.subplots()]
    )
    looks = {label: k for k, label in enumerate(dict.fromkeys(one.label for one in (*picture.traces, *picture.left)))}
    _draw(axes[0], picture.traces, looks, words)
    axes[0].set_ylabel(_upright(_axis(picture.y, picture.y_unit, words), _LONGEST_UPRIGHT))
    if picture.left:
        _draw(axes[1], picture.left, looks, words)
        axes[1].axhline(0.0, color=INK, linewidth=0.5)
        axes[1].set_ylabel(_upright(_axis(picture.left[0].label, picture.left_unit, words), _LONGEST_BELOW))
        figure.align_ylabels(axes)
    axes[-1].set_xlabel(_axis(picture.x, picture.x_unit, words))
    if picture.logarithmic:
        axes[0].set_xscale("log")
        if all((trace.y > 0).all() for trace in picture.traces):
            axes[0].set_yscale("log")
    for one in axes:
        _say_numbers(one, words)
    if len({trace.label for trace in picture.traces}) > 1:
        axes[0].legend(loc="best")
    return figure


class _Numbers(ScalarFormatter):
    """Numbers at an axis with the decimal sign of a language."""

    def __init__(self, words: Catalogue) -> None:
        super().__init__(useMathText=True)
        self._words = words

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self._words.number(super().__call__(x, pos)).replace(",", "{,}")  # no space after it


def _say_numbers(axes: Axes, words: Catalogue) -> None:
    if axes.get_xscale() == "linear":
        axes.xaxis.set_major_formatter(_Numbers(words))
    if axes.get_yscale() == "linear":
        axes.yaxis.set_major_formatter(_Numbers(words))


def _draw(axes: Axes, traces: Sequence[Trace], looks: Mapping[str, int], words: Catalogue) -> None:
    for trace in traces:
        look = looks[trace.label]
        colour, label = _COLOURS[look % len(_COLOURS)], words.word(trace.label)
        if not trace.dots:
            axes.plot(trace.x, trace.y, color=colour, linestyle=_DASHES[look % len(_DASHES)], label=label, zorder=1.5)
        elif trace.x.size > _MANY:
            dots(axes, trace.x, trace.y, colour)
            axes.plot([], [], linestyle="none", marker="o", markersize=2.8, color=colour, label=label)
        else:
            marker = _MARKERS[look % len(_MARKERS)]
            axes.plot(trace.x, trace.y, linestyle="none", marker=marker, markersize=3.0, color=colour, label=label)


def _axis(key: str, unit: str, words: Catalogue) -> str:
    name, printed = words.word(key), words.unit(unit)
    return f"{name}, {printed}" if printed else name


def _upright(told: str, longest: int) -> str:
    """A name beside an axis, its unit on a line of its own where both have more letters than the axis has room for."""
    name, comma, unit = told.rpartition(", ")
    return f"{name},\n{unit}" if comma and len(told) > longest else told
