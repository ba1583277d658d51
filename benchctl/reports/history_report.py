"""A history of units as JSON values and as lines for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from benchctl.closeness import meant, nearest
from benchctl.history.flags import Flag
from benchctl.history.history import Charted, History, UnitHistory
from benchctl.history.series import Drift, FigureSeries, Point
from benchctl.limits import listed
from benchctl.reports.history_charts import stated
from benchctl_instruments.errors import UsageError

_MOST_DATES = 3
_CAMPAIGN = ("path", "procedure", "started_utc", "status", "digest", "integrity")
_POINT = ("started_utc", "value", "uncertainty", "campaign", "integrity", "bound", "temperature_c")
MOST_PROBLEMS = 20
"""Number of problems shown on a page or terminal; `--json` lists all."""


def chosen(history: History, serial: str | None, figure: str | None) -> tuple[UnitHistory, ...]:
    """Select units and figures; the values that they are compared with do not change.

    Raises
    ------
    UsageError
        If there is no such unit or figure; the message names the available ones.
    """
    units = [unit for unit in history.units if serial is None or unit.serial == serial]
    if not units:
        serials = _once(history)
        close = nearest(str(serial), serials)
        hint = (
            f"; did you mean {close}?" if close else ""
        )  # in addition to the list: serial numbers resemble each other
        raise UsageError(f"--unit {serial}: there is no such unit; there are {listed(serials)}{hint}")
    names = list(dict.fromkeys(one.series.name for unit in units for one in unit.figures))
    if figure is not None and figure not in names:
        there = f"there are {listed(names)}" if names else "there is none: run benchctl fit or benchctl accept first"
        raise UsageError(f"--figure {figure}: there is no such figure; {meant(figure, names, there)}")
    return tuple(
        UnitHistory(
            serial=unit.serial,
            model=unit.model,
            campaigns=unit.campaigns,
            verdict=unit.verdict,
            accepted_utc=unit.accepted_utc,
            figures=tuple(one for one in unit.figures if figure is None or one.series.name == figure),
        )
        for unit in units
    )


def _once(history: History) -> list[str]:
    return list(dict.fromkeys(unit.serial for unit in history.units))


def values(history: History, units: Sequence[UnitHistory]) -> dict[str, Any]:
    """Return a history as plain data for `--json`."""
    return {
        "units": [
            {
                "serial": unit.serial,
                "model": unit.model,
                "verdict": unit.verdict or None,
                "accepted_utc": unit.accepted_utc or None,
                "campaigns": [{name: getattr(one, name) for name in _CAMPAIGN} for one in unit.campaigns],
                "figures": [_figure(one) for one in unit.figures],
            }
            for unit in units
        ],
        "problems": [{"where": problem.where, "says": problem.message} for problem in history.problems],
        "index": history.index,
    }


def _figure(charted: Charted) -> dict[str, Any]:
    series, siblings, latest = charted.series, charted.siblings, charted.series.latest
    return {
        "name": series.name,
        "unit": series.unit,
        "source": series.source,
        "points": [_point(series, point) for point in series.points],
        "control": charted.control and asdict(charted.control),
        "drift": _drift(charted.drift),
        "drift_since_first": _drift(charted.drift_since_first),
        "siblings": siblings and {"z": None if latest.bound else siblings.z(latest.value), **asdict(siblings)},
        "flags": [asdict(flag) for flag in charted.flags],
    }


def _point(series: FigureSeries, point: Point) -> dict[str, Any]:
    known = {name: getattr(point, name) for name in _POINT}
    limit = None if point.low is None and point.high is None else {"low": point.low, "high": point.high}
    return {**known, "stated": stated(series, point), "verdict": point.verdict or None, "limit": limit}


def _drift(drift: Drift | None) -> dict[str, Any] | None:
    if drift is None:
        return None
    return {
        "difference": drift.difference,
        "uncertainty": drift.uncertainty,
        "e_n": drift.e_n,
        "since": {"started_utc": drift.since.started_utc, "campaign": drift.since.campaign},
    }


def lines(history: History, units: Sequence[UnitHistory]) -> str:
    """Return the history for a terminal: a line for each unit, followed by its flagged figures."""
    width = max(4, *(len(unit.serial) for unit in units))
    model = max(5, *(len(unit.model) for unit in units))
    rows = [f"{'unit':<{width}}  {'model':<{model}}  campaigns  latest            verdict"]
    for unit in units:
        row = f"{unit.serial:<{width}}  {unit.model:<{model}}  {len(unit.campaigns):>9}  {latest_of(unit):<16}"
        rows.append(f"{row}  {verdict_of(unit)}".rstrip())
        rows += [f"  {one.series.name}: {'; '.join(sentences(one.flags))}" for one in unit.figures if one.flags]
    rows += [f"not counted: {problem}" for problem in history.problems[:MOST_PROBLEMS]]
    if len(history.problems) > MOST_PROBLEMS:
        rows.append(f"not counted: {len(history.problems) - MOST_PROBLEMS} more; --json names all")
    return "\n".join(rows)


def verdict_of(unit: UnitHistory) -> str:
    """Return the verdict of a unit's last acceptance, with its date if a later campaign was not judged."""
    if not unit.verdict or unit.accepted_utc == unit.campaigns[-1].started_utc:
        return unit.verdict
    return f"{unit.verdict} ({unit.accepted_utc[:10]})"


def sentences(flags: Sequence[Flag]) -> list[str]:
    """Return the sentences of flags; those of control limits are merged into one, the latest dates first."""
    dates = [flag.says.rpartition(" ")[2] for flag in flags if flag.kind == "outside_limits"][::-1]
    texts: dict[str, None] = {}
    for flag in flags:
        if flag.kind != "outside_limits":
            texts[flag.says] = None
            continue
        more = f" and {len(dates) - _MOST_DATES} earlier" if len(dates) > _MOST_DATES else ""
        texts[f"outside the control limits on {', '.join(dates[:_MOST_DATES])}{more}"] = None
    return list(texts)


def latest_of(unit: UnitHistory) -> str:
    """Return the start of a unit's last campaign, to the minute."""
    return unit.campaigns[-1].started_utc[:16].replace("T", " ")
