"""Which document states figures of which campaign: the one whose digest it names, wherever both lie."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from pathlib import PurePosixPath

from benchctl.history.model import Problem


def link(index: sqlite3.Connection) -> tuple[set[str], list[Problem]]:
    """Write into the index the campaign of each document; the campaigns that count, and what does not count, and why.

    A recording that is there twice counts once, by the first of its paths. Coefficients of several recordings count
    for the first of them that is there. A document that names no digest belongs to the one recording in its folder.
    Of two documents of one kind for one campaign that in the campaign's own folder counts, or else the first by path.
    """
    paths: dict[str, str] = {}
    problems = []
    alone: dict[PurePosixPath, list[str]] = defaultdict(list)
    counted = set()
    for path, digest in index.execute("SELECT path, digest FROM campaigns ORDER BY path"):
        if digest and digest in paths:
            problems.append(Problem(path, f"is the same recording as {paths[digest]}, and not counted again"))
            continue
        paths[digest] = path
        counted.add(path)
        alone[PurePosixPath(path).parent].append(path)
    taken: dict[tuple[str, str], str] = {}
    for document, source, digests in _nearest_first(index, paths):
        folder = PurePosixPath(document).parent
        there = [paths[digest] for digest in digests.split() if digest in paths]
        if not digests and len(alone[folder]) == 1:
            there = alone[folder]
        if not there:
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


def _nearest_first(index: sqlite3.Connection, paths: dict[str, str]) -> list[tuple[str, str, str]]:
    """Path, source and digests of the documents: those in the folder of a recording that they name come first."""

    def elsewhere(row: tuple[str, str, str]) -> bool:
        homes = {PurePosixPath(paths[digest]).parent for digest in row[2].split() if digest in paths}
        return PurePosixPath(row[0]).parent not in homes

    rows = index.execute("SELECT path, source, digests FROM documents ORDER BY path").fetchall()
    return sorted(rows, key=elsewhere)
