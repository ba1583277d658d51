"""The history of the units in a folder: their figures over time, charted, and each held against its siblings."""

from __future__ import annotations

import json
import sqlite3
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields
from pathlib import Path

from benchctl.history.control import Control, control_of
from benchctl.history.entries import words
from benchctl.history.flags import Flag, flags_of
from benchctl.history.found import find
from benchctl.history.index import keep, opened, place_of, refresh
from benchctl.history.linking import link
from benchctl.history.model import SOURCES, Campaign, Problem, Source
from benchctl.history.series import Drift, Point, Series, drifts
from benchctl.history.siblings import Siblings, siblings_of
from benchctl.limits import listed
from benchctl_instruments.errors import UsageError

_Kind = tuple[str, Source, str, str]
"""What is compared: model, source, name and unit of a figure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Charted:
    """A series and what is said of it: control limits, drift since the last and the first calibration, siblings."""

    series: Series
    control: Control | None
    drift: Drift | None
    drift_since_first: Drift | None
    siblings: Siblings | None
    flags: tuple[Flag, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitHistory:
    """A unit: its campaigns in the order of time, the verdict of its last acceptance and when that was, its figures.

    `verdict` and `accepted_utc` are empty where the unit was never accepted or rejected.
    """

    serial: str
    model: str
    campaigns: tuple[Campaign, ...]
    verdict: str
    accepted_utc: str
    figures: tuple[Charted, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """All units, sorted by model and serial; what is not part of it; where the index is kept (None: nowhere)."""

    units: tuple[UnitHistory, ...]
    problems: tuple[Problem, ...]
    index: Path | None


def history_of(
    folder: Path,
    name: str,
    say: Callable[[str], None],
    *,
    kept: bool = True,
    kept_at: Path | None = None,
    all_parameters: bool = False,
    follow_links: bool = True,
) -> History:
    """The history of a folder, by its index, which is brought up to date and, where `kept`, put back.

    The index is at `kept_at`, by default in the folder. `name` is what an error calls the folder; `say` hears of an
    index that is damaged or cannot be put back, on which the history does not depend. Of a unit's runs of one procedure
    those with other parameters than the latest are not charted or compared, unless `all_parameters`. Symbolic links in
    the folder are followed only with `follow_links`.

    Raises
    ------
    UsageError
        Where there is no campaign in the folder.
    """
    files, problems = find(folder, follow_links=follow_links)
    place = (kept_at or place_of(folder)) if kept else None
    with closing(opened(place, say)) as index:
        changed = refresh(index, files)
        counted, unlinked = link(index, {file.key: file.path for file in files})
        if place is not None and counted and (changed or not place.exists()):
            try:
                keep(index, place)
            except UsageError as err:
                say(f"{err}; the index is not kept")
                place = None
        unread = [Problem(*row) for row in index.execute("SELECT key, problem FROM files WHERE problem <> ''")]
        problems = sorted([*problems, *unread, *unlinked], key=lambda problem: problem.where)
        if not counted:
            more = f", and {len(problems) - 1} more" if len(problems) > 1 else ""
            found = f" ({problems[0]}{more})" if problems else ""
            raise UsageError(f"{name}: holds no campaign: expected recordings (*.h5) in it or below{found}")
        index.row_factory = sqlite3.Row
        unlike, left_out = (set[str](), list[Problem]()) if all_parameters else _unlike(index)
        return History(units=_units(index, counted, unlike), problems=(*left_out, *problems), index=place)


def _unlike(index: sqlite3.Connection) -> tuple[set[str], list[Problem]]:
    """Find the campaigns with other parameters than their unit's latest of that procedure, by their paths.

    Campaigns without figures are passed over. A sentence for each unit and procedure says how many there are, and why.
    """
    runs: dict[tuple[str, str, str], list[tuple[str, dict[str, object]]]] = defaultdict(list)
    for row in index.execute(
        "SELECT path, model, serial, procedure, parameters FROM campaigns WHERE procedure <> '' AND parameters <> '' "
        "AND path IN (SELECT campaign FROM documents) ORDER BY started_utc, path"
    ):
        runs[row["model"], row["serial"], row["procedure"]].append((row["path"], json.loads(row["parameters"])))
    unlike: set[str] = set()
    problems = []
    for (_, serial, procedure), found in runs.items():
        latest = found[-1][1]
        others = [(path, own) for path, own in found if own != latest]
        if others:
            unlike |= {path for path, _ in others}
            names = {name for _, own in others for name in latest | own if latest.get(name) != own.get(name)}
            says = (
                f"{len(others)} of {len(found)} runs of {words(procedure)} have other parameters than the latest "
                f"({words(listed(sorted(names)))}) and are not compared with it; --all-parameters compares them"
            )
            problems.append(Problem(serial, says))
    return unlike, problems


def _units(index: sqlite3.Connection, counted: set[str], unlike: set[str]) -> tuple[UnitHistory, ...]:
    campaigns: dict[tuple[str, str], list[Campaign]] = defaultdict(list)
    columns = ", ".join(field.name for field in fields(Campaign))
    for row in index.execute(f"SELECT {columns} FROM campaigns ORDER BY started_utc, path"):  # noqa: S608 - of ours
        if row["path"] in counted:
            campaigns[row["model"], row["serial"]].append(Campaign(**row))
    charted: dict[tuple[str, str], list[Charted]] = defaultdict(list)
    for one in _charted(_series(index, unlike)):
        charted[one.series.model, one.series.serial].append(one)
    accepted: dict[tuple[str, str], tuple[str, str]] = {}
    for row in index.execute(
        "SELECT c.model, c.serial, c.started_utc, d.verdict FROM documents d JOIN campaigns c ON d.campaign = c.path "
        "WHERE d.source = 'acceptance' ORDER BY c.started_utc, c.path"
    ):
        accepted[row["model"], row["serial"]] = row["verdict"], row["started_utc"]
    return tuple(
        UnitHistory(
            serial=serial,
            model=model,
            campaigns=tuple(campaigns[model, serial]),
            verdict=accepted.get((model, serial), ("", ""))[0],
            accepted_utc=accepted.get((model, serial), ("", ""))[1],
            figures=tuple(charted[model, serial]),
        )
        for model, serial in sorted(campaigns)
    )


def _series(index: sqlite3.Connection, unlike: set[str]) -> list[Series]:
    """All series without the campaigns `unlike`: by source, and within it in the order in which figures are stated."""
    points: dict[tuple[str, str, Source, str, str], list[Point]] = defaultdict(list)
    calibrated = {
        row["campaign"] for row in index.execute("SELECT campaign FROM documents WHERE source = 'coefficients'")
    }
    rows = index.execute(
        "SELECT c.serial, c.model, c.started_utc, c.path, d.integrity, f.* FROM figures f "
        "JOIN campaigns c ON f.campaign = c.path JOIN documents d ON f.document = d.path "
        "ORDER BY c.started_utc, c.path, f.rowid"
    )
    for row in rows:
        if row["path"] in unlike:
            continue
        points[row["serial"], row["model"], row["source"], row["name"], row["unit"]].append(
            Point(
                started_utc=row["started_utc"],
                campaign=row["path"],
                calibrated=row["path"] in calibrated,
                **{name: row[name] for name in _AS_STATED},
            )
        )
    series = [
        Series(serial=serial, model=model, source=source, name=name, unit=unit, points=tuple(found))
        for (serial, model, source, name, unit), found in points.items()
    ]
    return sorted(series, key=lambda one: SOURCES.index(one.source))


_AS_STATED = ("value", "uncertainty", "temperature_c", "bound", "verdict", "low", "high", "integrity")


def _charted(series: Sequence[Series]) -> list[Charted]:
    siblings = _siblings(series)
    found = []
    for one in series:
        values = [point.value for point in one.known]
        control = control_of(values)
        drift, since_first = drifts(one.known) or (None, None)
        others = siblings.get(_kind(one))
        found.append(
            Charted(
                series=one,
                control=control,
                drift=drift,
                drift_since_first=since_first,
                siblings=others,
                flags=flags_of(one, control, drift, since_first, others),
            )
        )
    return found


def _siblings(series: Sequence[Series]) -> Mapping[_Kind, Siblings]:
    """What the units of each model that is stated have in common."""
    latest: dict[_Kind, list[float]] = defaultdict(list)
    for one in series:
        if one.model and not one.latest.bound:
            latest[_kind(one)].append(one.latest.value)
    return {kind: found for kind, values in latest.items() if (found := siblings_of(values)) is not None}


def _kind(series: Series) -> _Kind:
    return series.model, series.source, series.name, series.unit
