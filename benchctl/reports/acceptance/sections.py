"""The section of one test: definition, conditions, points, picture, result, uncertainty budget, verdict, remedy."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from benchctl.calibration.result import Contribution
from benchctl.calibration.uncertainty import coverage_factor
from benchctl.metrology.names import PROCEDURES
from benchctl.metrology.result import Column, Judged, Measured, Picture, Trace, Uncertainty
from benchctl.recordings.model import StepInfo
from benchctl.reports import text
from benchctl.reports.acceptance import document
from benchctl.reports.acceptance.catalogue import (
    Catalogue,
    column,
    duration,
    limits,
    short,
    significant,
    stated,
    verdict_of,
)
from benchctl.reports.acceptance.document import Badge, Budget, Row, Section, Table
from benchctl.reports.figures import INK, Drawing, dots, inline_svg, new_figure, style

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_MARKERS = ("o", "s", "^", "D", "v", "P")
_DASHES = ("-", "--", "-.", ":")
_HEIGHT_IN, _HEIGHT_WITH_LEFT_IN = 2.3, 3.1
_MANY = 120
"""Number of dots above which small dots are drawn."""
_DPI = 250
_LONGEST_UPRIGHT, _LONGEST_BELOW = 26, 14


def drawn(picture: Picture, name: str, words: Catalogue) -> document.Picture:
    """Return the picture for page and PDF in the catalogue's language; `name` makes its ids unique."""
    x, y = words.word(picture.x), words.word(picture.y)
    caption = words.label("picture", x=x, y=y)
    if picture.left:
        caption = words.label("picture_left", x=x, y=y, left=words.word(picture.left[0].label))
    with style():
        figure = picture_figure(picture, words)
        svg = inline_svg(figure, name)
        figure.set_layout_engine("none")  # the layout is already computed
        pixels = io.BytesIO()
        figure.savefig(pixels, format="png", dpi=_DPI, metadata={"Software": None})
    return document.Picture(drawing=Drawing(svg=svg, alt=caption, caption=caption), png=pixels.getvalue())


def picture_figure(picture: Picture, words: Catalogue) -> Figure:
    """Plot the traces; both axes are logarithmic if requested, y only if all values are positive."""
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
    """An axis formatter with the decimal sign of a language."""

    def __init__(self, words: Catalogue) -> None:
        super().__init__(useMathText=True)
        self._words = words

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self._words.number(super().__call__(x, pos)).replace(",", "{,}")  # without the space that TeX adds


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
    """Return an axis title, with the unit on a second line if it is longer than `longest`."""
    name, comma, unit = told.rpartition(", ")
    return f"{name},\n{unit}" if comma and len(told) > longest else told


_MOST_DOF = 1000.0
_MINOR_SHARE = 1e-3
"""Share of the variance below which contributors are merged into one row."""
_WELL_KNOWN_SHARE = 0.8
"""Share of the variance above which only the largest contributor is named."""


def section(judged: Judged, number: str, infos: Mapping[int, StepInfo], words: Catalogue) -> Section:
    """Return the section of one test."""
    measured, texts = judged.measured, words.test(judged.measured.name)
    uncertainty = measured.uncertainty
    notes = measured.notes
    if uncertainty is not None and not uncertainty.contributors:  # a bound: it has no contributors
        notes, uncertainty = (*notes, uncertainty.says), None
    return Section(
        number=number,
        anchor=anchor(number),
        name=texts.name,
        verdict=badge(judged, words),
        result=_result(judged, words),
        refused=words.said(measured.refused) if measured.refused else "",
        remedy=words.said(judged.remedy) if judged.remedy else "",
        definition=texts.definition,
        formula=texts.formula,
        conditions=_conditions(measured, infos, words),
        notes=tuple(words.said(note) for note in notes),
        points=_points(measured.table, words) if measured.table else None,
        picture=drawn(measured.picture, anchor(number), words) if measured.picture else None,
        budget=_budget(uncertainty, measured.unit, words) if uncertainty else None,
    )


def anchor(number: str) -> str:
    """Return the id of a section in the page."""
    return f"test-{number.replace('.', '-')}"


def badge(judged: Judged, words: Catalogue) -> Badge:
    """Return the verdict on a test."""
    return Badge(text=verdict_of(judged, words), kind=judged.verdict or "")


def _result(judged: Judged, words: Catalogue) -> tuple[Row, ...]:
    measured = judged.measured
    value = "value" if measured.uncertainty else "value_short"
    return (
        (words.label(value), stated(measured, words)),
        (words.label("limit"), limits(judged.limit, words)),
    )


def _conditions(measured: Measured, infos: Mapping[int, StepInfo], words: Catalogue) -> tuple[Row, ...]:
    procedure = PROCEDURES.get(measured.name, "")
    used = [infos[index] for index in measured.steps if index in infos]
    rows = [(words.label("measured_by"), words.label("measured_by_told", procedure=procedure))] if procedure else []
    if measured.temperature_c is not None:
        celsius = words.number(f"{measured.temperature_c:.1f}".replace("-", "−"))
        rows.append((words.label("temperature"), text.with_unit(celsius, "°C")))
    if used:
        length_s = math.fsum(info.t_end - info.t_start for info in used)
        described = [*_groups(used, words), words.label("recorded_for", duration=duration(length_s, words))]
        rows.append((words.label("conditions"), "; ".join(described)))
    if measured.steps:
        rows.append((words.label("steps_used"), _spans(measured.steps)))
    return tuple(rows)


def _groups(used: Sequence[StepInfo], words: Catalogue) -> list[str]:
    """Describe steps by their kind: number, rates and frequencies."""
    kinds: dict[str, list[StepInfo]] = {}
    for info in used:
        kinds.setdefault(info.kind, []).append(info)
    return [_group(words.word(kind, "kinds"), members, words) for kind, members in kinds.items()]


def _group(kind: str, members: Sequence[StepInfo], words: Catalogue) -> str:
    rates = [info.amplitude_dps or info.rate_dps for info in members]
    described = words.label("group", kind=kind, count=str(len(members)))
    if any(rates):
        described = words.label("group_rates", kind=kind, count=str(len(members)), rates=_span(rates, words))
    frequencies = [info.frequency_hz for info in members]
    if any(frequencies):
        described += ", " + words.label("group_frequencies", frequencies=_span(frequencies, words))
    return described


def _span(values: Sequence[float | None], words: Catalogue) -> str:
    known = [value for value in values if value is not None]
    low, high = (words.number(short(end)) for end in (min(known), max(known)))
    return low if low == high else words.label("between", low=low, high=high)


def _spans(indices: Sequence[int]) -> str:
    """Format indices as `3–7, 9, 11–12`."""
    spans: list[list[int]] = []
    for index in sorted(indices):
        if spans and index == spans[-1][1] + 1:
            spans[-1][1] = index
        else:
            spans.append([index, index])
    return ", ".join(str(low) if low == high else f"{low}–{high}" for low, high in spans)


def _points(columns: Sequence[Column], words: Catalogue) -> Table:
    printed = [column(one.values, words) for one in columns]
    units = [words.unit(one.unit) for one in columns]
    return Table(
        headings=tuple(
            f"{words.word(one.name)}, {unit}" if unit else words.word(one.name)
            for one, unit in zip(columns, units, strict=True)
        ),
        rows=tuple(zip(*printed, strict=True)),
        numeric=(True,) * len(columns),
    )


def _budget(uncertainty: Uncertainty, unit: str, words: Catalogue) -> Budget:
    printed = words.unit(unit)
    total = math.fsum(part.standard**2 for part in uncertainty.contributors)
    shares = [part.standard**2 / total if total else 0.0 for part in uncertainty.contributors]
    k = coverage_factor(uncertainty.dof)
    heading = words.label("standard_uncertainty", unit=printed) if printed else words.label("standard_uncertainty_bare")
    return Budget(
        contributors=Table(
            headings=(words.label("source"), words.label("kind"), heading, words.label("share"), words.label("says")),
            rows=_contributors(uncertainty.contributors, shares, words),
            numeric=(False, False, True, True, False),
        ),
        totals=(
            (words.label("combined"), text.with_unit(_standard(uncertainty.standard, words), printed)),
            (_by_gum(uncertainty.dof, words), text.with_unit(_standard(k * uncertainty.standard, words), printed)),
            (words.label("monte_carlo"), text.with_unit(_standard(uncertainty.monte_carlo, words), printed)),
            (words.label("stated"), text.with_unit(_standard(uncertainty.expanded, words), printed)),
        ),
        largest=_largest(uncertainty.contributors, shares, words),
        says=words.said(uncertainty.says),
    )


def _contributors(
    contributors: Sequence[Contribution], shares: Sequence[float], words: Catalogue
) -> tuple[tuple[str, ...], ...]:
    """Return a row for each contributor; those with hardly any share of the variance are merged into the last row."""
    minor = [part for part, share in zip(contributors, shares, strict=True) if share < _MINOR_SHARE]
    kept = minor if len(minor) < 2 else []
    rows: list[tuple[str, ...]] = [
        (
            words.word(part.source, "sources"),
            part.kind,
            _standard(part.standard, words),
            _percent(share, words),
            words.phrase(part.says),
        )
        for part, share in zip(contributors, shares, strict=True)
        if share >= _MINOR_SHARE or part in kept
    ]
    if minor and not kept:
        together = math.hypot(*(part.standard for part in minor))
        names = ", ".join(dict.fromkeys(words.word(part.source, "sources") for part in minor))
        kinds = ", ".join(sorted({part.kind for part in minor}))
        share = math.fsum(share for share in shares if share < _MINOR_SHARE)
        rows.append((words.label("others"), kinds, _standard(together, words), _percent(share, words), names))
    return tuple(rows)


def _by_gum(dof: float, words: Catalogue) -> str:
    """Return the coverage factor by the degrees of freedom; from a thousand on these are printed as infinite."""
    dof_text = significant(dof, words, 2) if dof < _MOST_DOF else words.label("unlimited")
    return words.label("k_combined", k=significant(coverage_factor(dof), words), dof=dof_text)


def _largest(contributors: Sequence[Contribution], shares: Sequence[float], words: Catalogue) -> str:
    """Name the largest contribution, and the second unless the first exceeds `_WELL_KNOWN_SHARE`."""
    if not any(shares):
        return ""
    names = [words.word(part.source, "sources") for part in contributors]
    first, first_share = names[0], f"{100.0 * shares[0]:.0f}"
    if shares[0] > _WELL_KNOWN_SHARE or len(names) == 1:
        return words.label("largest", source=first, share=first_share)
    second_share = f"{100.0 * shares[1]:.0f}"
    return words.label("largest_two", source=first, share=first_share, second=names[1], second_share=second_share)


def _standard(value: float, words: Catalogue) -> str:
    return significant(value, words, 3) if value else "0"


def _percent(share: float, words: Catalogue) -> str:
    if not share:
        return "0\u00a0%"
    return "<\u00a0" + words.number("0.1\u00a0%") if share < 1e-3 else words.number(f"{100.0 * share:.1f}\u00a0%")
