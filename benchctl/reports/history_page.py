"""The HTML page on a history: a section per unit with its charts, and charts that compare the units."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from benchctl.history.flags import FEWEST, Flag, Siblings
from benchctl.history.history import Charted, History, UnitHistory
from benchctl.history.series import SOURCES, FigureSeries, Source
from benchctl.reports import text
from benchctl.reports.figures import Drawing
from benchctl.reports.history_charts import amount, stated, time_chart, units_chart
from benchctl.reports.history_report import MOST_PROBLEMS, latest_of, sentences, verdict_of
from benchctl.reports.html import render, write_page
from benchctl.reports.results import make_folder

REPORT = "history.html"
_TITLES: dict[Source, str] = {"acceptance": "Acceptance tests", "coefficients": "Calibration"}


def write_page_of(history: History, units: Sequence[UnitHistory], folder: Path, title: str) -> Path:
    """Write the page atomically; return its path."""
    make_folder(folder)
    page = render(
        "history.html.j2",
        title=title,
        sections=[_section(unit, f"unit-{number}") for number, unit in enumerate(units, 1)],
        comparisons=_comparisons(history, units),
        problems=history.problems[:MOST_PROBLEMS],
        more_problems=max(0, len(history.problems) - MOST_PROBLEMS),
        campaigns=sum(len(unit.campaigns) for unit in units),
    )
    write_page(folder / REPORT, page)
    return folder / REPORT


def _section(unit: UnitHistory, anchor: str) -> dict[str, object]:
    groups = [
        (_TITLES[source], [_chart(one) for one in unit.figures if one.series.source == source]) for source in SOURCES
    ]
    return {
        "unit": unit,
        "anchor": anchor,
        "latest": latest_of(unit),
        "verdict": verdict_of(unit),
        "looked_at": [one.series.name for one in unit.figures if one.flags],
        "groups": [(name, charts) for name, charts in groups if charts],
    }


def _chart(charted: Charted) -> dict[str, object]:
    series = charted.series
    latest = stated(series, series.latest)
    drawing = Drawing(
        svg=time_chart(charted), alt=f"{series.name} of {series.serial} over time, latest {latest}", caption=""
    )
    return {
        "name": series.name,
        "latest": latest,
        "drawing": drawing,
        "says": _printed(charted.flags),
        "facts": _facts(charted),
    }


def _printed(flags: Sequence[Flag]) -> list[str]:
    return [sentence.replace("= -", "= −").replace("E_n = ", "Eₙ\u00a0=\u00a0") for sentence in sentences(flags)]


def _facts(charted: Charted) -> list[str]:
    """Return the facts printed below a chart: limits, drift, number of points."""
    series, latest = charted.series, charted.series.latest
    unit = text.unit_text(series.unit)
    facts = []
    if latest.low is not None or latest.high is not None:
        facts.append(f"limit {_limit(latest.low, latest.high, unit)}")
    if (drift := charted.drift) is not None:
        e_n = "" if drift.e_n is None else f", Eₙ\u00a0=\u00a0{text.number(drift.e_n, 2)}"
        change = amount(drift.difference, drift.uncertainty, series.unit)
        facts.append(f"{change} since {drift.since.started_utc[:10]}{e_n}")
    if charted.control is None and series.known:
        facts.append(f"{text.count(len(series.known))} of {FEWEST} points for control limits")
    return facts


def _limit(low: float | None, high: float | None, unit: str) -> str:
    ends = [text.with_unit(text.number(end, 4), unit) for end in (low, high) if end is not None]
    if low is not None and high is not None:
        return " to ".join(ends)
    return f"at least {ends[0]}" if high is None else f"at most {ends[0]}"


def _comparisons(history: History, units: Sequence[UnitHistory]) -> list[tuple[str, list[dict[str, object]]]]:
    """Return for each model the charts of figures that at least two units have; all units of the model are drawn."""
    wanted = {(one.series.source, one.series.name) for unit in units for one in unit.figures}
    found: dict[tuple[str, Source, str, str], list[FigureSeries]] = defaultdict(list)
    common: dict[tuple[str, Source, str, str], Siblings | None] = {}
    models = {unit.model for unit in units}
    for unit in history.units:
        for one in unit.figures if unit.model in models else ():
            series = one.series
            key = (series.model, series.source, series.name, series.unit)
            found[key].append(series)
            common[key] = one.siblings
    by_model: dict[str, list[dict[str, object]]] = defaultdict(list)
    for source in SOURCES:
        for key, series_of in found.items():
            model, of, name, unit_text = key
            if of != source or len(series_of) < 2 or (of, name) not in wanted:
                continue
            drawing = Drawing(
                svg=units_chart(series_of, common[key]), alt=f"latest {name} of {len(series_of)} units", caption=""
            )
            by_model[model].append({"name": name, "unit": text.unit_text(unit_text), "drawing": drawing})
    return list(by_model.items())
