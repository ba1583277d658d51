"""The files of campaigns in a folder: recordings, and what is stated of them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchctl.history.model import Problem, Source
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, RECORDING, STEPS, UNREADABLE
from instruments.errors import reason

DOCUMENTS: dict[str, Source] = {"coefficients.json": "coefficients", "acceptance.json": "acceptance"}


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundFile:
    """A file as the folder shows it: `key` is its path in the folder, `source` None for a recording."""

    key: str
    path: Path
    source: Source | None
    size: int
    mtime_ns: int


def is_wanted(name: str) -> bool:
    """Whether a file of this name, without folders, is a recording or states figures of one."""
    return name in DOCUMENTS or (name.endswith(FINISHED_SUFFIX) and name != CAMPAIGN and not name.startswith("."))


def find(folder: Path) -> tuple[list[FoundFile], list[Problem]]:
    """Recordings and documents anywhere below a folder, sorted by their paths; and campaigns that are not finished.

    Hidden folders are left out, links are followed once.
    """
    files: list[FoundFile] = []
    problems: list[Problem] = []
    for place, names in _folders(folder, problems):
        if CAMPAIGN in names and RECORDING not in names:
            says = "is not finished and not counted; benchctl recover closes the recording of a campaign that died"
            problems.append(Problem(_key(place, folder), says))
        for name in filter(is_wanted, names):
            path = place / name
            try:
                stat = path.stat()
            except OSError as err:
                problems.append(Problem(_key(path, folder), f"cannot be read: {reason(err)}"))
                continue
            files.append(
                FoundFile(
                    key=_key(path, folder),
                    path=path,
                    source=DOCUMENTS.get(name),
                    size=stat.st_size,
                    mtime_ns=stat.st_mtime_ns,
                )
            )
    return sorted(files, key=lambda file: file.key), problems


def _folders(folder: Path, problems: list[Problem]) -> Iterator[tuple[Path, list[str]]]:
    """Every folder once, however it is linked, with the names of its files."""

    def told(err: OSError) -> None:
        problems.append(Problem(_key(Path(err.filename), folder), f"cannot be looked into: {reason(err)}"))

    seen: set[tuple[int, int]] = set()
    for place, folders, names in os.walk(folder, followlinks=True, onerror=told):
        stat = os.stat(place)
        # A file system without such numbers says 0: its folders have no links either.
        if stat.st_ino and (stat.st_dev, stat.st_ino) in seen:
            folders.clear()
            continue
        seen.add((stat.st_dev, stat.st_ino))
        inner = {STEPS, UNREADABLE} if CAMPAIGN in names or RECORDING in names else set()
        folders[:] = sorted(name for name in folders if not name.startswith(".") and name not in inner)
        yield Path(place), names


def _key(path: Path, folder: Path) -> str:
    """A path in the folder as text; bytes of a name that are no text are shown as such."""
    text = path.relative_to(folder).as_posix()
    return os.fsencode(text).decode("utf-8", "backslashreplace")
