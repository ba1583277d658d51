"""Which document states figures of which campaign, and which copy of a recording counts: the one that is intact.

Files are checked against the manifest of their campaign's folder: documents by their SHA-256, recordings by their size
and the digest of their root. What was altered does not count. Of several copies of a recording one that agrees with its
manifest comes before one that has none. Where that does not decide and the copies state different figures, all samples
of each are checked.
"""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from benchctl.history.model import Problem
from benchctl.recordings.campaign_manifest import Integrity
from benchctl.recordings.verify import refuse_changed
from benchctl_instruments.errors import UsageError

_ALTERED = "was altered since the manifest of its folder was written, and is not counted"


def link(index: sqlite3.Connection, places: Mapping[str, Path]) -> tuple[set[str], list[Problem]]:
    """Write into the index the campaign of each document; the campaigns that count, and what does not count, and why.

    `places` are the files by their keys. A recording that is there several times counts once. Coefficients of several
    recordings count for the first of them that is there. A document that names no digest belongs to the one recording
    in its folder. Of two documents of one kind for one campaign one that agrees with its manifest counts, then that in
    the campaign's own folder, then the first by path.
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
            problems.append(Problem(document, _ALTERED))
        elif not there:
            problems.append(Problem(document, "is of a recording that is not here as it was then, and not counted"))
        elif (there[0], source) in taken:
            says = f"is of {there[0]}, as is {taken[there[0], source]}, which counts"
            problems.append(Problem(document, says))
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
    """Set the integrity of recordings and documents by what the manifests say of them."""
    same = {"campaigns": "s.digest = t.digest AND s.bytes = f.size", "documents": "s.sha256 = t.sha256"}
    with index:
        for table, condition in same.items():
            index.execute(
                f"UPDATE {table} SET integrity = coalesce((SELECT CASE WHEN {condition} THEN 'verified' "  # noqa: S608
                f"ELSE 'altered' END FROM {table} t JOIN files f ON f.key = t.path JOIN sealed s ON s.file = t.path "
                f"WHERE t.path = {table}.path ORDER BY length(s.manifest) DESC), 'not verified')"
            )


def _originals(index: sqlite3.Connection, places: Mapping[str, Path]) -> tuple[dict[str, str], list[Problem]]:
    """The recording that counts for each digest, and why others do not."""
    copies: dict[str, list[tuple[str, Integrity]]] = defaultdict(list)
    rows = index.execute("SELECT path, digest, integrity FROM campaigns ORDER BY integrity = 'not verified', path")
    for path, digest, integrity in rows.fetchall():
        copies[digest or f"without a digest: {path}"].append((path, integrity))
    stated = _stated(index)
    paths, problems = {}, []
    for digest, found in copies.items():
        problems += [Problem(path, _ALTERED) for path, integrity in found if integrity == "altered"]
        usable = [(path, integrity) for path, integrity in found if integrity != "altered"]
        best = [path for path, integrity in usable if integrity == usable[0][1]]
        if len({stated[PurePosixPath(path).parent] for path in best}) > 1:
            changed = {path: says for path in best if (says := _change_in(index, path, places[path]))}
            problems += [Problem(path, says) for path, says in changed.items()]
            usable = [one for one in usable if one[0] not in changed]
        if not usable:
            continue
        paths[digest] = first = usable[0][0]
        for path, integrity in usable[1:]:
            says = f"is the same recording as {first}, and not counted again"
            if integrity != "verified":
                says += "; it is not verified, for no manifest names it"
            elif stated[PurePosixPath(path).parent] != stated[PurePosixPath(first).parent]:
                says += "; it states other figures, and nothing here shows which are right"
            problems.append(Problem(path, says))
    return paths, problems


def _stated(index: sqlite3.Connection) -> Mapping[PurePosixPath, frozenset[str]]:
    """By folder the contents of the documents in it that were not altered."""
    found: dict[PurePosixPath, frozenset[str]] = defaultdict(frozenset)
    for path, sha256 in index.execute("SELECT path, sha256 FROM documents WHERE integrity <> 'altered'"):
        found[PurePosixPath(path).parent] |= {sha256}
    return found


def _change_in(index: sqlite3.Connection, path: str, place: Path) -> str:
    """What of a recording does not agree with its digests, in words; empty where all does. It is checked once."""
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
    """Path, source, digests and integrity of the documents: verified ones first, then those beside their recording."""

    def order(row: tuple[str, str, str, str]) -> tuple[bool, bool]:
        homes = {PurePosixPath(paths[digest]).parent for digest in row[2].split() if digest in paths}
        return row[3] != "verified", PurePosixPath(row[0]).parent not in homes

    rows = index.execute("SELECT path, source, digests, integrity FROM documents ORDER BY path").fetchall()
    return sorted(rows, key=order)
