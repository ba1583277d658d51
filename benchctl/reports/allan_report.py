"""The report on an Allan analysis: figure, table of deviations and noise terms, as HTML, JSON values and plain text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchctl.atomic import whole_file
from benchctl.metrology.allan import DIGITS, NAMES, TERMS, Allan, Coefficient, Term, unit_of, variances
from benchctl.recordings.text_file import csv_rows
from benchctl.reports import text
from benchctl.reports.figures import GREY, INK, Drawing, inline_svg, new_figure, style
from benchctl.reports.html import render, write_page
from benchctl.reports.results import make_folder
from benchctl_instruments.arrays import FloatArray

REPORT, TABLE = "allan.html", "allan.csv"
_COLOURS = dict(zip(TERMS, ("#D55E00", "#0072B2", "#009E73", "#E69F00", "#CC79A7"), strict=True))
_DASHES = dict(zip(TERMS, ("--", "-.", ":", (0, (5, 1)), (0, (1, 1))), strict=True))
_COLUMNS = {"tau_s": 4, "deviation": 5, "ci95_low": 4, "ci95_high": 4, "degrees_of_freedom": 3}
"""Columns of the table, with the number of significant digits shown on the page."""
_SHOWN = 14
_CAPTION = (
    "Overlapping Allan deviation with 95 % intervals; the terms that the record has, and their sum. Averaging times"
    " beyond a ninth of the record are shown and not fitted."
)


def values(found: Allan) -> dict[str, Any]:
    """Return the analysis as plain data for `--json`."""
    coefficients: dict[str, Any] = {}
    for term in TERMS:
        one, unit = _in_units(found, term)
        coefficients[term] = one and {"value": one.value, "ci95": list(one.ci95), "unit": unit}
    return {
        "source": found.series.source,
        "unit": found.series.unit,
        "samples": found.series.values.size,
        "rate_hz": 1.0 / found.series.interval_s,
        "tau_s": found.tau_s.tolist(),
        "deviation": found.deviation.tolist(),
        "ci95": found.ci95.tolist(),
        "degrees_of_freedom": found.freedom.tolist(),
        "coefficients": coefficients,
        "refused": dict(found.terms.refused),
        "misfit": found.misfit and asdict(found.misfit),
    }


def lines(found: Allan) -> str:
    """Return the analysis as plain text: a selection of averaging times, and every noise term."""
    chosen = np.unique(np.linspace(0, found.tau_s.size - 1, _SHOWN).round().astype(int))
    rows = [f"{'tau':>12}  {'deviation':>13}  95 % interval   ({found.series.source}, {found.series.unit})"]
    rows += [
        f"{found.tau_s[k]:>10.4g} s  {found.deviation[k]:>13.5g}  {found.ci95[k, 0]:.5g} to {found.ci95[k, 1]:.5g}"
        for k in chosen.tolist()
    ]
    rows += [f"{row.term}  {row.name}: {row.stated}" for row in term_rows(found)]
    return "\n".join(rows + cautions(found))


def cautions(found: Allan) -> list[str]:
    """Return warnings about averaging times at which the noise terms do not describe the record."""
    misfit = found.misfit
    if misfit is None:
        return []
    tau_s, deviation, modelled = (text.number(one, 3) for one in (misfit.tau_s, misfit.deviation, misfit.modelled))
    return [
        f"The five terms do not describe this record: at τ = {tau_s} s its deviation is {deviation} "
        f"{found.series.unit}, they make {modelled}. Their values and intervals do not hold; look for a line in its "
        "spectrum, for correlated noise, or for a filter before the samples."
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class TermRow:
    """One noise term as printed."""

    term: Term
    name: str
    stated: str


def term_rows(found: Allan) -> list[TermRow]:
    """Return all five terms, including those that were not determined."""
    return [TermRow(term=term, name=NAMES[term], stated=_stated(found, term)) for term in TERMS]


def _stated(found: Allan, term: Term) -> str:
    one, unit = _in_units(found, term)
    if one is None:
        return f"none: {found.terms.refused[term]}"
    low, high = (text.number(limit, 4) for limit in one.ci95)
    return f"{text.number(one.value, 4)} {unit}, 95 % interval {low} to {high}"


def _in_units(found: Allan, term: Term) -> tuple[Coefficient | None, str]:
    """Return a term's coefficient, or None if it was not determined, and the unit in which it is stated."""
    one, unit = found.terms.found.get(term), unit_of(term, found.series.unit)
    if one is None:
        return None, unit.name
    low, high = one.ci95
    return Coefficient(value=unit.factor * one.value, ci95=(unit.factor * low, unit.factor * high)), unit.name


def write_report(found: Allan, folder: Path, title: str) -> list[Path]:
    """Write the page and the table, each atomically; return their paths."""
    make_folder(folder)
    with style():
        svg = inline_svg(allan_figure(found), "allan")
    drawing = Drawing(svg=svg, alt=f"Allan deviation of {found.series.source}", caption=_CAPTION)
    page = render(
        "allan.html.j2",
        title=title,
        found=found,
        drawing=drawing,
        terms=term_rows(found),
        cautions=cautions(found),
        rows=_table_rows(found),
        rate_hz=text.number(1.0 / found.series.interval_s, 6),
    )
    write_page(folder / REPORT, page)
    with whole_file(folder / TABLE) as temporary:
        temporary.write_bytes(",".join(_COLUMNS).encode() + b"\n" + b"".join(csv_rows(_columns(found), list(_COLUMNS))))
    return [folder / REPORT, folder / TABLE]


def allan_figure(found: Allan) -> Figure:
    """Plot the deviation with its intervals, the noise terms and their sum, on logarithmic axes."""
    figure = new_figure(3.6)
    axes = figure.subplots()
    axes.fill_between(found.tau_s, found.ci95[:, 0], found.ci95[:, 1], color=GREY, alpha=0.25, linewidth=0)
    axes.plot(found.tau_s, found.deviation, color=INK, marker="o", markersize=2.4, label="overlapping Allan deviation")
    grid_s = np.geomspace(found.tau_s[0], found.tau_s[-1], 200)
    parts = variances(grid_s, found.series.interval_s)
    total = np.zeros_like(grid_s)
    for term, one in found.terms.found.items():
        part = parts[:, TERMS.index(term)] * one.value**2
        total += part
        label = f"{term}, {NAMES[term]}"
        axes.plot(grid_s, np.sqrt(part), color=_COLOURS[term], linestyle=_DASHES[term], linewidth=0.9, label=label)
    if len(found.terms.found) > 1:
        axes.plot(grid_s, np.sqrt(total), color=GREY, linewidth=0.8, label="their sum")
    high = float(found.ci95[:, 1].max())
    low = float(found.ci95[found.deviation > DIGITS * high, 0].min())  # a regular toggle averages to 0
    axes.set(xscale="log", yscale="log", ylim=(0.7 * low, 1.4 * high))
    axes.set(xlabel="averaging time τ (s)", ylabel=f"deviation ({found.series.unit})")
    axes.set_title("Allan deviation")
    axes.legend(loc="best")
    return figure


def _columns(found: Allan) -> list[FloatArray]:
    """Return the columns of the table in the order of `_COLUMNS`."""
    return [found.tau_s, found.deviation, *found.ci95.T, found.freedom]


def _table_rows(found: Allan) -> Sequence[tuple[str, ...]]:
    return [
        tuple(text.number(value, digits) for value, digits in zip(row, _COLUMNS.values(), strict=True))
        for row in np.stack(_columns(found), axis=1).tolist()
    ]
