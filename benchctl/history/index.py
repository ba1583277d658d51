"""The index: a SQLite cache of the contents of a folder of campaigns, so that only changed files are read again.

It is only a cache: each entry belongs to a file of one size and modification time. It is modified in memory and stored
atomically, so that two processes at once each read and store a complete index; the later one remains. A file of another
version, or in which SQLite finds an error, is ignored and replaced.

    files      key, size, mtime_ns, problem        key: path in the folder; problem: why it cannot be read, or empty
    campaigns  path, serial, model, procedure, started_utc, status, digest, parameters, integrity, content
    documents  path, source, verdict, digests, campaign, sha256, integrity
    sealed     manifest, file, sha256, bytes, digest    entries of manifests
    figures    document, campaign, name, unit, value, uncertainty, temperature_c, bound, source, verdict, low, high

`uncertainty` is expanded (95.45 %); `campaign` is null until the document's recording is found. `integrity` is set when
the index is linked; `content` of a recording is empty until its digests were checked, then `intact` or what changed.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import astuple, dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

from benchctl.atomic import whole_file
from benchctl.confined import walk
from benchctl.history.entries import read_campaign, read_document, words
from benchctl.history.series import Campaign, Document, Source
from benchctl.recordings.campaign_manifest import MANIFEST, Entry, content_of, entries_of
from benchctl.recordings.digests import Mismatch
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, RECORDING, STEPS, UNREADABLE
from benchctl_instruments.errors import UsageError, reason

Kind = Source | Literal["recording", "manifest"]

_KINDS: dict[str, Kind] = {
    "coefficients.json": "coefficients",
    "acceptance.json": "acceptance",
    MANIFEST: "manifest",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundFile:
    """A file in the folder: `key` is its path relative to the folder, `kind` the type of its content."""

    key: str
    path: Path
    kind: Kind
    size: int
    mtime_ns: int


def is_wanted(name: str) -> bool:
    """Return whether a file name, without folders, is that of a recording, a manifest, or a document with figures."""
    return name in _KINDS or (name.endswith(FINISHED_SUFFIX) and name != CAMPAIGN and not name.startswith("."))


def find(folder: Path, *, follow_links: bool = True) -> tuple[list[FoundFile], list[Mismatch]]:
    """Return recordings, documents and manifests below a folder, sorted by path; and unfinished campaigns.

    Hidden folders are left out; links are left out as well, or followed once.
    """
    files: list[FoundFile] = []
    problems: list[Mismatch] = []
    for place, names in _folders(folder, problems, follow_links=follow_links):
        if CAMPAIGN in names and RECORDING not in names:
            message = "is not finished and not counted; benchctl recover closes the recording of a campaign that died"
            problems.append(Mismatch(_key(place, folder), message))
        for name in filter(is_wanted, names):
            path = place / name
            if not follow_links and path.is_symlink():
                continue
            try:
                stat = path.stat(follow_symlinks=follow_links)
            except OSError as err:
                problems.append(Mismatch(_key(path, folder), f"cannot be read: {reason(err)}"))
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


def _folders(folder: Path, problems: list[Mismatch], *, follow_links: bool) -> Iterator[tuple[Path, list[str]]]:
    """Yield every folder once, however it is linked, with the names of its files."""

    def report(err: OSError) -> None:
        problems.append(Mismatch(_key(Path(err.filename), folder), f"cannot be looked into: {reason(err)}"))

    visited: set[tuple[int, int]] = set()
    found = os.walk(folder, followlinks=True, onerror=report) if follow_links else walk(folder, report)
    for place, folders, names in found:
        stat = os.stat(place, follow_symlinks=follow_links)
        # A file system without such numbers returns 0: its folders have no links either.
        if stat.st_ino and (stat.st_dev, stat.st_ino) in visited:
            folders.clear()
            continue
        visited.add((stat.st_dev, stat.st_ino))
        inner = {STEPS, UNREADABLE} if CAMPAIGN in names or RECORDING in names else set()
        folders[:] = sorted(name for name in folders if not name.startswith(".") and name not in inner)
        yield Path(place), names


def _key(path: Path, folder: Path) -> str:
    """Return a path in the folder as text; undecodable bytes are escaped."""
    text = path.relative_to(folder).as_posix()
    return os.fsencode(text).decode("utf-8", "backslashreplace")


NAME = ".benchctl-history.sqlite"
VERSION = 3
_SCHEMA = f"""
CREATE TABLE files (key text PRIMARY KEY, size integer, mtime_ns integer, problem text);
CREATE TABLE campaigns (path text PRIMARY KEY REFERENCES files ON DELETE CASCADE, serial text, model text,
    procedure text, started_utc text, status text, digest text, parameters text, integrity text, content text);
CREATE TABLE documents (path text PRIMARY KEY REFERENCES files ON DELETE CASCADE, source text, verdict text,
    digests text, campaign text, sha256 text, integrity text);
CREATE TABLE sealed (manifest text REFERENCES files ON DELETE CASCADE, file text, sha256 text, bytes integer,
    digest text);
CREATE TABLE figures (document text REFERENCES documents ON DELETE CASCADE, campaign text, name text, unit text,
    value real, uncertainty real, temperature_c real, bound text, source text, verdict text, low real, high real);
CREATE INDEX figures_by_document ON figures (document);
PRAGMA user_version = {VERSION};
"""


def place_of(folder: Path) -> Path:
    """Return the path of a folder's index: in it, or in the user's cache if the folder is not writable."""
    if os.access(folder, os.W_OK | os.X_OK):
        return folder / NAME
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    name = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:32]
    return cache / "benchctl" / f"history-{name}.sqlite"


@contextmanager
def opened(place: Path | None) -> Iterator[sqlite3.Connection]:
    """Load the index into memory; it is empty if there is none of this version at `place`.

    Raises `sqlite3.Error` if it is damaged; so may each statement on it later.
    """
    with closing(sqlite3.connect(":memory:")) as index:
        index.execute("PRAGMA foreign_keys = ON")
        if place is not None and place.exists():
            # This file is only ever replaced, never modified: it needs no locks, and no journal belongs to it.
            with closing(sqlite3.connect(f"{place.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as kept:
                if kept.execute("PRAGMA user_version").fetchone() == (VERSION,):
                    kept.backup(index)
        if index.execute("PRAGMA user_version").fetchone() == (0,):
            index.executescript(_SCHEMA)
        yield index


def keep(index: sqlite3.Connection, place: Path) -> None:
    """Store the index atomically; raises `UsageError` if it cannot be written."""
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise UsageError(f"{place.parent}: cannot be made: {reason(err)}") from err
    with whole_file(place) as temporary, closing(sqlite3.connect(temporary)) as kept:
        index.backup(kept)


def refresh(index: sqlite3.Connection, files: Iterable[FoundFile]) -> bool:
    """Remove missing or changed files from the index and read new ones; return whether anything changed.

    Unreadable files are tried again each time, because a change of permissions changes neither size nor time.
    """
    now = {file.key: file for file in files}
    known = {
        key: (size, mtime_ns, problem)
        for key, size, mtime_ns, problem in index.execute("SELECT key, size, mtime_ns, problem FROM files")
    }
    stale = [key for key, state in known.items() if key not in now or state != (now[key].size, now[key].mtime_ns, "")]
    with index:
        index.executemany("DELETE FROM files WHERE key = ?", [(key,) for key in stale])
        for key in sorted(now.keys() - (known.keys() - set(stale))):
            _add(index, now[key])
    return bool(stale) or now.keys() != known.keys()


def _add(index: sqlite3.Connection, file: FoundFile) -> None:
    """Add a file to the index, or the reason why it cannot be read."""
    add_file = "INSERT INTO files VALUES (?, ?, ?, ?)"
    entry: Campaign | Document | Mapping[str, Entry]
    try:
        match file.kind:
            case "recording":
                entry = read_campaign(file.path, file.key)
            case "manifest":
                entry = entries_of(file.path.parent)
            case source:
                entry = read_document(file.path, source)
    except UsageError as err:
        message = str(err).replace(f"{file.path}: ", "").replace(str(file.path), file.key)
        index.execute(add_file, (file.key, file.size, file.mtime_ns, message))
        return
    index.execute(add_file, (file.key, file.size, file.mtime_ns, ""))
    if isinstance(entry, Campaign):
        index.execute("INSERT INTO campaigns VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, '')", astuple(entry))
        return
    if not isinstance(entry, Document):
        index.executemany("INSERT INTO sealed VALUES (?, ?, ?, ?, ?)", _sealed(file.key, entry))
        return
    sha256 = content_of(file.path)["sha256"]
    index.execute(
        "INSERT INTO documents VALUES (?, ?, ?, ?, NULL, ?, 'not verified')",
        (file.key, entry.source, entry.verdict, " ".join(entry.digests), sha256),
    )
    index.executemany(
        "INSERT INTO figures (document, source, name, unit, value, uncertainty, temperature_c, bound, verdict, low, "
        "high) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        [(file.key, entry.source, *astuple(figure)) for figure in entry.figures],
    )


def _sealed(manifest: str, entries: Mapping[str, Entry]) -> list[tuple[str, str, str, int, str]]:
    """Return the manifest entries of the files in the index."""
    folder = PurePosixPath(manifest).parent
    return [
        (
            manifest,
            (folder / name).as_posix(),
            words(entry.get("sha256", "")),
            size if isinstance(size := entry.get("bytes"), int) and 0 <= size < 1 << 63 else -1,
            words(entry.get("digest", "")),
        )
        for name, entry in entries.items()
        if is_wanted(PurePosixPath(name).name)
    ]
