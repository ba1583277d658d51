"""The files of campaigns in a folder: recordings, what is stated of them, and their manifests."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchctl.confined import walk
from benchctl.history.model import Problem, Source
from benchctl.recordings.campaign_manifest import MANIFEST
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, RECORDING, STEPS, UNREADABLE
from benchctl_instruments.errors import reason

Kind = Source | Literal["recording", "manifest"]

_KINDS: dict[str, Kind] = {
    "coefficients.json": "coefficients",
    "acceptance.json": "acceptance",
    MANIFEST: "manifest",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundFile:
    """A file as the folder shows it: `key` is its path in the folder, `kind` what it holds."""

    key: str
    path: Path
    kind: Kind
    size: int
    mtime_ns: int


def is_wanted(name: str) -> bool:
    """Whether a file of this name, without folders, is a recording, a manifest, or states figures of a recording."""
    return name in _KINDS or (name.endswith(FINISHED_SUFFIX) and name != CAMPAIGN and not name.startswith("."))


def find(folder: Path, *, follow_links: bool = True) -> tuple[list[FoundFile], list[Problem]]:
    """Recordings, documents and manifests anywhere below a folder, sorted by their paths; unfinished campaigns.

    Hidden folders are left out; links are left out, too, or followed once.
    """
    files: list[FoundFile] = []
    problems: list[Problem] = []
    for place, names in _folders(folder, problems, follow_links=follow_links):
        if CAMPAIGN in names and RECORDING not in names:
            says = "is not finished and not counted; benchctl recover closes the recording of a campaign that died"
            problems.append(Problem(_key(place, folder), says))
        for name in filter(is_wanted, names):
            path = place / name
            if not follow_links and path.is_symlink():
                continue
            try:
                stat = path.stat(follow_symlinks=follow_links)
            except OSError as err:
                problems.append(Problem(_key(path, folder), f"cannot be read: {reason(err)}"))
                continue
            files.append(
                FoundFile(
                    key=_key(path, folder),
                    path=path,
                    kind=_KINDS.get(name, "recording"),
                    size=stat.st_size,
                    mtime_ns=stat.st_mtime_ns,
                )
            )
    return sorted(files, key=lambda file: file.key), problems


def _folders(folder: Path, problems: list[Problem], *, follow_links: bool) -> Iterator[tuple[Path, list[str]]]:
    """Every folder once, however it is linked, with the names of its files."""

    def told(err: OSError) -> None:
        problems.append(Problem(_key(Path(err.filename), folder), f"cannot be looked into: {reason(err)}"))

    seen: set[tuple[int, int]] = set()
    found = os.walk(folder, followlinks=True, onerror=told) if follow_links else walk(folder, told)
    for place, folders, names in found:
        stat = os.stat(place, follow_symlinks=follow_links)
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
