"""Find recordings by paths, patterns and URLs, and fetch those at URLs with fsspec.

Every backend of fsspec works (s3:// needs s3fs, gs:// gcsfs, sftp:// paramiko, …); file:// is always available, and
zip://units/*.h5::URL for files in an archive.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from benchctl.limits import listed
from benchctl.recordings.import_open import OPEN_DESCRIPTION
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, RECORDING, STEPS, UNREADABLE
from benchctl_instruments.errors import UsageError, in_line, reason

Kind = Literal["file", "campaign", "open"]

_MARKS: dict[str, Kind] = {RECORDING: "campaign", CAMPAIGN: "campaign", OPEN_DESCRIPTION: "open"}
"""The files that make a folder a recording, with the kind; the first one present decides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Located:
    """A recording: an absolute path or a URL. `size` is in bytes.

    `stamp` contains name, size and modification time of its files. Equal stamps mean an unchanged recording; with
    different or missing stamps the content may still be the same.
    """

    where: str
    kind: Kind
    size: int
    stamp: tuple[str, ...]

    @property
    def remote(self) -> bool:
        """Whether it is a URL, and has to be fetched."""
        return is_url(self.where)

    @property
    def name(self) -> str:
        """Its name without the path, and without the suffix of recordings."""
        return self.where.partition("::")[0].rpartition("/")[2].removesuffix(FINISHED_SUFFIX)


def is_url(text: str) -> bool:
    """Return whether a text is a URL, not a path."""
    return "://" in text


def located(globs: Sequence[str]) -> tuple[list[Located], list[str]]:
    """Find the recordings that paths, patterns and URLs name, sorted without duplicates; and those that name none.

    Files in a campaign's folder are not recordings of their own. Other matches of a pattern are left out.

    Raises
    ------
    UsageError
        If one of them matches nothing, or none of the matches is a recording.
    """
    found: dict[str, Located] = {}
    others: list[str] = []
    for text in globs:
        matches = remote_matches(text) if is_url(text) else _local(text)
        for match, recording in matches:
            if recording is not None:
                found.setdefault(recording.where if recording.remote else os.path.realpath(recording.where), recording)
            elif match == os.path.expanduser(text):
                others.append(text)
    if not found:
        folders = [text for text in globs if os.path.isdir(os.path.expanduser(text))]
        hint = f"; for all below a folder: '{folders[0].rstrip('/')}/**'" if folders else ""
        raise UsageError(
            f"{listed([*globs])}: no recording there; expected *.h5, campaigns' folders or open recordings'{hint}"
        )
    return sorted(found.values(), key=lambda recording: recording.where), others


def kind_of(names: Iterable[str]) -> Kind | None:
    """Return the kind of recording of a folder that contains these files; None if it is not one."""
    there = set(names)
    return next((kind for mark, kind in _MARKS.items() if mark in there), None)


def owner_of(way: Sequence[str]) -> int:
    """Return how many parts of a file's path name the recording that it belongs to; 0 if there is none.

    >>> owner_of(("lab", "SN-17", "recording.h5")), owner_of(("lab", "a.h5")), owner_of(("lab", "SN-17", "README.md"))
    (2, 2, 0)
    """
    *folders, name = way
    if name in _MARKS:
        return len(folders)
    if not name.endswith(FINISHED_SUFFIX) or folders[-1:] in ([STEPS], [UNREADABLE]):
        return 0
    return len(way)


def _local(text: str) -> Iterator[tuple[str, Located | None]]:
    pattern = os.path.expanduser(text)
    matches = [pattern] if os.path.lexists(pattern) else sorted(glob.glob(pattern, recursive=True))
    if not matches:
        raise UsageError(f"{text}: matches nothing; expected recordings: paths, patterns such as 'results/**', or URLs")
    return ((match, _located(Path(os.path.abspath(match)))) for match in matches)


def _located(path: Path) -> Located | None:
    if not path.is_dir():
        owner = Path(*path.parts[: owner_of(path.parts)])
        if owner == path:
            return Located(where=str(path), kind="file", size=_size([path]), stamp=_stamp([path], path.parent))
        if path.name not in _MARKS:
            return None
        path = owner
    try:
        kind = kind_of(os.listdir(path))
    except OSError as err:
        raise UsageError(f"{path}: cannot be looked into: {reason(err)}") from err
    if kind is None:
        return None
    files = files_of(path, kind)
    return Located(where=str(path), kind=kind, size=_size(files), stamp=_stamp(files, path))


def files_of(path: Path, kind: Kind) -> list[Path]:
    """Return the files that a local recording consists of."""
    if kind == "file":
        return [path]
    if kind == "open":
        return sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
    if (path / RECORDING).exists():
        return [path / RECORDING]
    return [path / CAMPAIGN, *sorted(file for file in (path / STEPS).glob("*") if file.is_file())]


def _size(files: Iterable[Path]) -> int:
    return sum(file.stat().st_size for file in files if file.exists())


def _stamp(files: Iterable[Path], folder: Path) -> tuple[str, ...]:
    stats = ((file.relative_to(folder).as_posix(), file.stat()) for file in files if file.exists())
    return tuple(f"{name} {stat.st_size} {stat.st_mtime_ns}" for name, stat in stats)


_VERSIONS = ("ETag", "etag", "md5Hash", "version_id", "CRC")
_CHANGES = ("mtime", "LastModified", "last_modified", "updated", "modified")
_TOLD_BY = (*_VERSIONS, *_CHANGES)
"""Names that filesystems use for a file's version, checksum or modification time; the first present one is used."""

Info = Mapping[str, Any]


@contextmanager
def remote_errors(url: str) -> Iterator[None]:
    """Convert all errors of a filesystem to a `UsageError` that names the URL."""
    try:
        yield
    except UsageError:
        raise
    except ImportError as err:
        raise UsageError(f"{url}: {in_line(str(err))}; pip install what it names, here and where workers are") from err
    except NotImplementedError as err:
        raise UsageError(f"{url}: nothing can be written there; give --out, a folder or URL for all results") from err
    except Exception as err:  # each backend has its own errors
        why = in_line(str(err)) or type(err).__name__
        raise UsageError(f"{url}: cannot be reached or read: {why}") from err


def filesystem(url: str) -> tuple[Any, str]:
    """Return the filesystem of a URL, and the path on it; call it within `remote_errors`."""
    try:
        from fsspec.core import url_to_fs
    except ImportError as err:
        raise UsageError(f"{url}: URLs need fsspec; pip install 'benchctl[cluster]'") from err
    found: tuple[Any, str] = url_to_fs(url)
    return found


def remote_matches(url: str) -> Iterator[tuple[str, Located | None]]:
    """Yield the matches of a URL, which may be a pattern, each with its recording; None where it is none.

    Raises `UsageError` if it matches nothing or cannot be read.
    """
    with remote_errors(url):
        system, pattern = filesystem(url)
        there = system.exists(pattern)
        matches = {pattern: system.info(pattern)} if there else system.glob(pattern, detail=True)
    if not matches:
        raise UsageError(f"{url}: matches nothing; expected recordings: s3://bucket/unit-*.h5, for example")
    _, inside, archive = url.partition("::")
    for path, info in sorted(matches.items()):
        with remote_errors(url):
            recording = _remote_located(system, path, info)
        if recording is not None and inside:  # the filesystem of an archive knows only the path inside it
            recording = replace(recording, where=f"{recording.where}::{_absolute(archive)}")
        yield system.unstrip_protocol(path) + inside + archive, recording


def _absolute(archive: str) -> str:
    """Return an archive's URL, or its absolute path for workers, whose current folder differs."""
    return archive if "://" in archive else f"file://{os.path.abspath(archive)}"


def fetch(recording: Located, folder: Path) -> Path:
    """Fetch a recording into a folder and return its path. Raises `UsageError` if that fails."""
    with remote_errors(recording.where):
        system, path = filesystem(recording.where)
        place = folder / path.rstrip("/").rpartition("/")[2]
        files = {path: {}} if recording.kind == "file" else _files(system, path, recording.kind)
        for file in files:
            to = place / file.removeprefix(path).lstrip("/") if file != path else place
            to.parent.mkdir(parents=True, exist_ok=True)
            system.get_file(file, str(to))
    return place


def _remote_located(system: Any, path: str, info: Info) -> Located | None:
    if info["type"] != "directory":
        parts = path.split("/")
        owner = owner_of(parts)
        if owner == 0:
            return None
        if owner == len(parts):
            return _of_files(system, path, "file", {path: info})
        path = "/".join(parts[:owner])
    names = [entry.rstrip("/").rpartition("/")[2] for entry in system.ls(path, detail=False)]
    kind = kind_of(names)
    return None if kind is None else _of_files(system, path, kind, _files(system, path, kind))


def _files(system: Any, path: str, kind: Kind) -> dict[str, Info]:
    """Return the files of a recording that is a folder, by path; of a complete campaign only the recording itself."""
    complete = f"{path.rstrip('/')}/{RECORDING}"
    if kind == "campaign" and system.exists(complete):
        return {complete: system.info(complete)}
    found: dict[str, Info] = system.find(path, detail=True)
    return found


def _of_files(system: Any, path: str, kind: Kind, files: Mapping[str, Info]) -> Located:
    entries = [(name.removeprefix(path), info.get("size"), _version(info)) for name, info in sorted(files.items())]
    return Located(
        where=system.unstrip_protocol(path.rstrip("/")),
        kind=kind,
        size=sum(size or 0 for _, size, _ in entries),
        stamp=tuple(" ".join(map(str, one)) for one in entries) if all(version for *_, version in entries) else (),
    )


def _version(info: Info) -> str:
    """Return the version of a file; empty if its filesystem has none."""
    return next((str(info[name]) for name in _TOLD_BY if info.get(name) is not None), "")
