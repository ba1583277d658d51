"""The section of one test: definition, conditions, points, picture, result, uncertainty budget, verdict, remedy."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from benchctl.calibration.result import Contribution
from benchctl.calibration.uncertainty import K, coverage_factor
from benchctl.metrology.names import PROCEDURES
from benchctl.metrology.result import Column, Judged, Limit, Measured, Picture, Trace, Uncertainty
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
from benchctl.reports.acceptance.set_up import set_points
from benchctl.reports.figures import INK, dots, new_figure, style

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_MARKERS = ("o", "s", "^", "D", "v", "P")
_DASHES = ("-", "--", "-.", ":")
_LIMIT = "#b3261e"
_WIDTH_IN, _HEIGHT_IN, _HEIGHT_WITH_LEFT_IN = 3.42, 1.9, 2.2
_MANY, _SMALL = 100, 3.5
"""Number of dots above which small dots are drawn, and their size in points."""
_DPI = 300
_EIGHT_POINTS: dict[Any, Any] = dict.fromkeys(
    ("font.size", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize"), 8.0
)


def drawn(judged: Judged, picture: Picture, words: Catalogue) -> document.Picture:
    """Return a test's picture for page and PDF in the catalogue's language, with a caption that states the finding."""
    with style(), mpl.rc_context(_EIGHT_POINTS):
        pixels = io.BytesIO()
        limit = judged.limit if judged.limit and judged.limit.unit == _limited_unit(picture) else None
        picture_figure(picture, limit, words).savefig(pixels, format="png", dpi=_DPI, metadata={"Software": None})
    return document.Picture(png=pixels.getvalue(), caption=" ".join(_finding(judged, picture, limit, words)))


def _limited_unit(picture: Picture) -> str:
    return {"x": picture.x_unit, "y": picture.y_unit, "": ""}[picture.limited]


def _finding(judged: Judged, picture: Picture, limit: Limit | None, words: Catalogue) -> Iterator[str]:
    yield words.label(
        "finding",
        name=words.test(judged.measured.name).name,
        value=stated(judged.measured, words),
        limit=limits(judged.limit, words),
        verdict=verdict_of(judged, words),
    )
    if picture.limited == "y":
        readings = picture.traces[0]
        at = readings.x[int(np.argmax(np.abs(readings.y)))]
        yield words.label("largest_at", x=text.with_unit(words.number(short(at)), words.unit(picture.x_unit)))
    if any(trace.standard is not None for trace in picture.traces):
        yield words.label("bars")
    if limit:
        yield words.label("dashed")


def picture_figure(picture: Picture, limit: Limit | None, words: Catalogue) -> Figure:
    """Plot the traces and a limit; both axes are logarithmic if requested, y only if all values are positive."""
    figure = new_figure(_HEIGHT_WITH_LEFT_IN if picture.left else _HEIGHT_IN, _WIDTH_IN)
    axes: list[Axes] = list(
        np.atleast_1d(figure.subplots(2, 1, sharex=True, height_ratios=(5, 3))) if picture.left else [figure.subplots()]
    )
    looks = {label: k for k, label in enumerate(dict.fromkeys(one.label for one in (*picture.traces, *picture.left)))}
    _draw(axes[0], picture.traces, looks, words)
    axes[0].set_title(_axis(picture.y, picture.y_unit, words), loc="left")
    if picture.left:
        _draw(axes[1], picture.left, looks, words)
        axes[1].axhline(0.0, color=INK, linewidth=0.5)
        axes[1].set_title(_axis(picture.left[0].label, picture.left_unit, words), loc="left")
    axes[-1].set_xlabel(_axis(picture.x, picture.x_unit, words))
    if picture.logarithmic:
        axes[0].set_xscale("log")
        if all((trace.y > 0).all() for trace in picture.traces):
            axes[0].set_yscale("log")
    for one in axes:
        _draw_limit(one, picture.limited, limit)
        _say_numbers(one, words)
    if len({trace.label for trace in picture.traces}) > 1:
        axes[0].legend(loc="best")
    return figure


def _draw_limit(axes: Axes, axis: str, limit: Limit | None) -> None:
    """Draw the ends of a limit; an upper one of magnitudes also below zero."""
    if limit is None:
        return
    ends = {limit.low, limit.high, -limit.high if axis == "y" and limit.low is None and limit.high else None}
    for end in ends - {None}:
        draw = axes.axvline if axis == "x" else axes.axhline
        draw(float(end or 0.0), color=_LIMIT, linestyle="--", linewidth=1.0)


class _Numbers(ScalarFormatter):
    """An axis formatter with the decimal sign of a language."""

    def __init__(self, words: Catalogue) -> None:
        super().__init__(useOffset=False)  # mathtext would take half of the time of a figure
        self._words = words

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self._words.number(super().__call__(x, pos))


def _say_numbers(axes: Axes, words: Catalogue) -> None:
    if axes.get_xscale() == "linear":
        axes.xaxis.set_major_formatter(_Numbers(words))
    if axes.get_yscale() == "linear":
        axes.yaxis.set_major_formatter(_Numbers(words))


def _draw(axes: Axes, traces: Sequence[Trace], looks: Mapping[str, int], words: Catalogue) -> None:
    for trace in traces:
        look = looks[trace.label]
        colour, label = _COLOURS[look % len(_COLOURS)], words.word(trace.label)
        if trace.standard is not None:
            axes.errorbar(
                trace.x, trace.y, K * trace.standard, linestyle="none", ecolor=colour, elinewidth=0.7, zorder=1.2
            )
        if not trace.dots:
            axes.plot(trace.x, trace.y, color=colour, linestyle=_DASHES[look % len(_DASHES)], label=label, zorder=1.5)
        elif trace.x.size > _MANY:
            dots(axes, trace.x, trace.y, colour, size=_SMALL)
            axes.plot([], [], linestyle="none", marker="o", markersize=2.8, color=colour, label=label)
        else:
            marker = _MARKERS[look % len(_MARKERS)]
            axes.plot(trace.x, trace.y, linestyle="none", marker=marker, markersize=3.0, color=colour, label=label)


def _axis(key: str, unit: str, words: Catalogue) -> str:
    name, printed = words.word(key), words.unit(unit)
    return f"{name}, {printed}" if printed else name


_MOST_DOF = 1000.0
_MINOR_SHARE = 1e-3
"""Share of the variance below which contributors are merged into one row."""


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
        steps=_spans(measured.steps),
        notes=tuple(words.said(note) for note in notes),
        points=_points(measured.table, words) if measured.table else None,
        picture=drawn(judged, measured.picture, words) if measured.picture else None,
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


def _conditions(measured: Measured, infos: Mapping[int, StepInfo], words: Catalogue) -> str:
    """Describe procedure, temperature and steps; over several set points the range of temperatures."""
    used = [infos[index] for index in measured.steps if index in infos]
    parts = [PROCEDURES[measured.name]]
    points_c = {info.chamber_setpoint_c for info in used if math.isfinite(info.chamber_setpoint_c)}
    if len(points_c) > 1:
        parts.append(set_points(points_c, words))
    elif measured.temperature_c is not None:
        celsius = words.number(f"{measured.temperature_c:.1f}".replace("-", "−"))
        parts.append(words.label("unit_at", temperature=text.with_unit(celsius, "°C")))
    if used:
        length_s = math.fsum(info.t_end - info.t_start for info in used)
        parts += [*_groups(used, words), words.label("recorded_for", duration=duration(length_s, words))]
    return "; ".join(one for one in parts if one)


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
    return Table(
        headings=tuple(_axis(one.name, one.unit, words) for one in columns),
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
        totals=words.label(
            "totals",
            standard=_standard(uncertainty.standard, words),
            k=significant(k, words),
            dof=significant(uncertainty.dof, words, 2) if uncertainty.dof < _MOST_DOF else "∞",
            gum=_standard(k * uncertainty.standard, words),
            monte_carlo=_standard(uncertainty.monte_carlo, words),
            expanded=text.with_unit(_standard(uncertainty.expanded, words), printed),
        ),
        says="" if uncertainty.says.key == "gum_agrees" else words.said(uncertainty.says),
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


def _standard(value: float, words: Catalogue) -> str:
    return significant(value, words, 2) if value else "0"


def _percent(share: float, words: Catalogue) -> str:
    if not share:
        return "0\u00a0%"
    return "<\u00a0" + words.number("0.1\u00a0%") if share < 1e-3 else words.number(f"{100.0 * share:.1f}\u00a0%")
