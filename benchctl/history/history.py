"""The history of the units in a folder: each figure over time, with its control limits, drift and flags.

Files are checked against the manifest of their campaign's folder: documents by their SHA-256, recordings by their size
and the digest of their root. Altered files are not counted. Of several copies of a recording, one that agrees with its
manifest is preferred to one without a manifest. If that does not decide and the copies state different figures, all
samples of each are checked.
"""

from __future__ import annotations

import json
import sqlite3
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath

from benchctl.history.entries import words
from benchctl.history.flags import Control, Flag, Siblings, control_of, flags_of, siblings_of
from benchctl.history.index import FoundFile, find, keep, opened, place_of, refresh
from benchctl.history.series import SOURCES, Campaign, Drift, FigureSeries, Point, Source, drifts
from benchctl.limits import listed
from benchctl.recordings.campaign_manifest import Integrity
from benchctl.recordings.digests import Mismatch
from benchctl.recordings.verify import refuse_changed
from benchctl_instruments.errors import UsageError

_ALTERED = "was altered since the manifest of its folder was written, and is not counted"


def link(index: sqlite3.Connection, places: Mapping[str, Path]) -> tuple[set[str], list[Mismatch]]:
    """Store the campaign of each document in the index; return the counted campaigns, and the problems with the others.

    `places` are the files by their keys. Several copies of a recording count once. Coefficients from several recordings
    count for the first one present. A document that names no digest belongs to the only recording in its folder. If two
    documents of one kind belong to one campaign, one that agrees with its manifest counts, then the one in the
    campaign's own folder, then the first by path.
    """
    _check_integrity(index)
    paths, problems = _originals(index, places)
    counted = set(paths.values())
    alone: dict[PurePosixPath, list[str]] = defaultdict(list)
    for path in sorted(counted):
        alone[PurePosixPath(path).parent].append(path)
    taken: dict[tuple[str, str], str] = {}
    for document, source, digests, integrity in _best_first(index, paths):
        folder = PurePosixPath(document).parent
        there = [paths[digest] for digest in digests.split() if digest in paths]
        if not digests and len(alone[folder]) == 1:
            there = alone[folder]
        if integrity == "altered":
            problems.append(Mismatch(document, _ALTERED))
        elif not there:
            problems.append(Mismatch(document, "is of a recording that is not here as it was then, and not counted"))
        elif (there[0], source) in taken:
            message = f"is of {there[0]}, as is {taken[there[0], source]}, which counts"
            problems.append(Mismatch(document, message))
        else:
            taken[there[0], source] = document
    campaigns = {document: campaign for (campaign, _), document in taken.items()}
    with index:
        for table, name in (("documents", "path"), ("figures", "document")):
            index.execute(f"UPDATE {table} SET campaign = NULL")  # noqa: S608 - names of ours
            index.executemany(
                f"UPDATE {table} SET campaign = ? WHERE {name} = ?",  # noqa: S608 - names of ours
                [(campaign, document) for document, campaign in campaigns.items()],
            )
    return counted, problems


def _check_integrity(index: sqlite3.Connection) -> None:
    """Set the integrity of recordings and documents according to the manifests."""
    same = {"campaigns": "s.digest = t.digest AND s.bytes = f.size", "documents": "s.sha256 = t.sha256"}
    with index:
        for table, condition in same.items():
            index.execute(
                f"UPDATE {table} SET integrity = coalesce((SELECT CASE WHEN {condition} THEN 'verified' "  # noqa: S608
                f"ELSE 'altered' END FROM {table} t JOIN files f ON f.key = t.path JOIN sealed s ON s.file = t.path "
                f"WHERE t.path = {table}.path ORDER BY length(s.manifest) DESC), 'not verified')"
            )


def _originals(index: sqlite3.Connection, places: Mapping[str, Path]) -> tuple[dict[str, str], list[Mismatch]]:
    """Return the recording that counts for each digest, and the reasons why others do not."""
    copies: dict[str, list[tuple[str, Integrity]]] = defaultdict(list)
    rows = index.execute("SELECT path, digest, integrity FROM campaigns ORDER BY integrity = 'not verified', path")
    for path, digest, integrity in rows.fetchall():
        copies[digest or f"without a digest: {path}"].append((path, integrity))
    stated = _stated(index)
    paths, problems = {}, []
    for digest, found in copies.items():
        problems += [Mismatch(path, _ALTERED) for path, integrity in found if integrity == "altered"]
        usable = [(path, integrity) for path, integrity in found if integrity != "altered"]
        best = [path for path, integrity in usable if integrity == usable[0][1]]
        if len({stated[PurePosixPath(path).parent] for path in best}) > 1:
            changed = {path: problem for path in best if (problem := _change_in(index, path, places[path]))}
            problems += [Mismatch(path, problem) for path, problem in changed.items()]
            usable = [one for one in usable if one[0] not in changed]
        if not usable:
            continue
        paths[digest] = first = usable[0][0]
        for path, integrity in usable[1:]:
            problem = f"is the same recording as {first}, and not counted again"
            if integrity != "verified":
                problem += "; it is not verified, for no manifest names it"
            elif stated[PurePosixPath(path).parent] != stated[PurePosixPath(first).parent]:
                problem += "; it states other figures, and nothing here shows which are right"
            problems.append(Mismatch(path, problem))
    return paths, problems


def _stated(index: sqlite3.Connection) -> Mapping[PurePosixPath, frozenset[str]]:
    """Return the SHA-256 of the unaltered documents of each folder."""
    found: dict[PurePosixPath, frozenset[str]] = defaultdict(frozenset)
    for path, sha256 in index.execute("SELECT path, sha256 FROM documents WHERE integrity <> 'altered'"):
        found[PurePosixPath(path).parent] |= {sha256}
    return found


def _change_in(index: sqlite3.Connection, path: str, place: Path) -> str:
    """Return a sentence on a recording's mismatch with its digests; empty if it agrees. The check is done once."""
    (known,) = index.execute("SELECT content FROM campaigns WHERE path = ?", (path,)).fetchone()
    if not known:
        try:
            refuse_changed(place, "counted")
            known = "intact"
        except UsageError as err:
            known = str(err).replace(f"{place}: ", "")
        with index:
            index.execute("UPDATE campaigns SET content = ? WHERE path = ?", (known, path))
    return "" if known == "intact" else str(known)


def _best_first(index: sqlite3.Connection, paths: dict[str, str]) -> list[tuple[str, str, str, str]]:
    """Return path, source, digests and integrity of documents: verified first, then those next to their recording."""

    def order(row: tuple[str, str, str, str]) -> tuple[bool, bool]:
        homes = {PurePosixPath(paths[digest]).parent for digest in row[2].split() if digest in paths}
        return row[3] != "verified", PurePosixPath(row[0]).parent not in homes

    rows = index.execute("SELECT path, source, digests, integrity FROM documents ORDER BY path").fetchall()
    return sorted(rows, key=order)


_Kind = tuple[str, Source, str, str]
"""The key of a comparison: model, source, name and unit of a figure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Charted:
    """A series with its control limits, drift since the last and the first calibration, siblings and flags."""

    series: FigureSeries
    control: Control | None
    drift: Drift | None
    drift_since_first: Drift | None
    siblings: Siblings | None
    flags: tuple[Flag, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitHistory:
    """A unit: its campaigns in the order of time, the verdict and time of its last acceptance, its figures.

    `verdict` and `accepted_utc` are empty if the unit was never accepted or rejected.
    """

    serial: str
    model: str
    campaigns: tuple[Campaign, ...]
    verdict: str
    accepted_utc: str
    figures: tuple[Charted, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """All units, sorted by model and serial; problems with files; the path of the index (None: not stored)."""

    units: tuple[UnitHistory, ...]
    problems: tuple[Mismatch, ...]
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
    """Return the history of a folder from its index, which is updated and, if `kept`, stored.

    The index is at `kept_at`, by default in the folder. `name` is the folder's name in errors; `say` is called with a
    warning if an index is damaged or cannot be stored, which does not affect the history. Of a unit's runs of one
    procedure, those with other parameters than the latest are not charted or compared, unless `all_parameters`.
    Symbolic links in the folder are followed only with `follow_links`.

    Raises
    ------
    UsageError
        If there is no campaign in the folder.
    """
    files, problems = find(folder, follow_links=follow_links)
    place = (kept_at or place_of(folder)) if kept else None
    try:
        with opened(place) as index:
            return _history(index, files, problems, name, say, place, all_parameters=all_parameters)
    except sqlite3.Error as err:
        say(f"{place}: {err}; the index is thrown away and made anew from the recordings")
    with opened(None) as index:
        return _history(index, files, problems, name, say, place, all_parameters=all_parameters)


def _history(
    index: sqlite3.Connection,
    files: Sequence[FoundFile],
    problems: Sequence[Mismatch],
    name: str,
    say: Callable[[str], None],
    place: Path | None,
    *,
    all_parameters: bool,
) -> History:
    """Return the history of a folder with these files and problems; update the index, and store it at `place`."""
    changed = refresh(index, files)
    counted, unlinked = link(index, {file.key: file.path for file in files})
    if place is not None and counted and (changed or not place.exists()):
        try:
            keep(index, place)
        except UsageError as err:
            say(f"{err}; the index is not kept")
            place = None
    unread = [Mismatch(*row) for row in index.execute("SELECT key, problem FROM files WHERE problem <> ''")]
    problems = sorted([*problems, *unread, *unlinked], key=lambda problem: problem.where)
    if not counted:
        more = f", and {len(problems) - 1} more" if len(problems) > 1 else ""
        found = f" ({problems[0]}{more})" if problems else ""
        raise UsageError(f"{name}: holds no campaign: expected recordings (*.h5) in it or below{found}")
    index.row_factory = sqlite3.Row
    unlike, left_out = (set[str](), list[Mismatch]()) if all_parameters else _unlike(index)
    return History(units=_units(index, counted, unlike), problems=(*left_out, *problems), index=place)


def _unlike(index: sqlite3.Connection) -> tuple[set[str], list[Mismatch]]:
    """Return the paths of campaigns with other parameters than their unit's latest of that procedure.

    Campaigns without figures are ignored. A sentence per unit and procedure gives their number, and the reason.
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
            message = (
                f"{len(others)} of {len(found)} runs of {words(procedure)} have other parameters than the latest "
                f"({words(listed(sorted(names)))}) and are not compared with it; --all-parameters compares them"
            )
            problems.append(Mismatch(serial, message))
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


def _series(index: sqlite3.Connection, unlike: set[str]) -> list[FigureSeries]:
    """Return all series without the campaigns `unlike`: by source, then in the order of their figures."""
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
        FigureSeries(serial=serial, model=model, source=source, name=name, unit=unit, points=tuple(found))
        for (serial, model, source, name, unit), found in points.items()
    ]
    return sorted(series, key=lambda one: SOURCES.index(one.source))


_AS_STATED = ("value", "uncertainty", "temperature_c", "bound", "verdict", "low", "high", "integrity")


def _charted(series: Sequence[FigureSeries]) -> list[Charted]:
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


def _siblings(series: Sequence[FigureSeries]) -> Mapping[_Kind, Siblings]:
    """Return the statistics of the units of each known model."""
    latest: dict[_Kind, list[float]] = defaultdict(list)
    for one in series:
        if one.model and not one.latest.bound:
            latest[_kind(one)].append(one.latest.value)
    return {kind: found for kind, values in latest.items() if (found := siblings_of(values)) is not None}


def _kind(series: FigureSeries) -> _Kind:
    return series.model, series.source, series.name, series.unit
