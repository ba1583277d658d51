"""Recordings and results at URLs, by fsspec: looked for, fetched, put; its errors in one line.

Every backend that fsspec finds will do (s3:// needs s3fs, gs:// gcsfs, sftp:// paramiko, …); file:// is always there,
and zip://units/*.h5::URL for what is in an archive.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchctl.fleet.located import Kind, Located, kind_of, owner_of
from benchctl.recordings.schema import RECORDING
from benchctl_instruments.errors import UsageError, in_line

_VERSIONS = ("ETag", "etag", "md5Hash", "version_id", "CRC")
_CHANGES = ("mtime", "LastModified", "last_modified", "updated", "modified")
_TOLD_BY = (*_VERSIONS, *_CHANGES)
"""What filesystems call a file's version, sum or time of change; the first that one knows is part of the stamp."""

Info = Mapping[str, Any]


@contextmanager
def remote_errors(url: str) -> Iterator[None]:
    """Turn what a filesystem refuses, in whatever way, into a `UsageError` that names the URL."""
    try:
        yield
    except UsageError:
        raise
    except ImportError as err:
        raise UsageError(f"{url}: {in_line(str(err))}; pip install what it names, here and where workers are") from err
    except NotImplementedError as err:
        raise UsageError(f"{url}: nothing can be written there; give --out, a folder or URL for all results") from err
    except Exception as err:  # each backend has errors of its own
        says = in_line(str(err)) or type(err).__name__
        raise UsageError(f"{url}: cannot be reached or read: {says}") from err


def filesystem(url: str) -> tuple[Any, str]:
    """The filesystem of a URL, and the path on it; call it within `remote_errors`."""
    try:
        from fsspec.core import url_to_fs
    except ImportError as err:
        raise UsageError(f"{url}: URLs need fsspec; pip install 'benchctl[cluster]'") from err
    found: tuple[Any, str] = url_to_fs(url)
    return found


def remote_matches(url: str) -> Iterator[tuple[str, Located | None]]:
    """What a URL, which may be a pattern, matches; None beside what is no recording.

    Raises `UsageError` where it matches nothing or cannot be looked at.
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
            recording = _located(system, path, info)
        if recording is not None and inside:  # of which its filesystem says only the way within
            recording = replace(recording, where=f"{recording.where}::{_absolute(archive)}")
        yield system.unstrip_protocol(path) + inside + archive, recording


def _absolute(archive: str) -> str:
    """An archive's URL, or its path as workers need it, whose current folder is another."""
    return archive if "://" in archive else f"file://{os.path.abspath(archive)}"


def fetch(recording: Located, folder: Path) -> Path:
    """Fetch a recording into a folder; where it is there. Raises `UsageError` where that fails."""
    with remote_errors(recording.where):
        system, path = filesystem(recording.where)
        place = folder / path.rstrip("/").rpartition("/")[2]
        files = {path: {}} if recording.kind == "file" else _files(system, path, recording.kind)
        for file in files:
            to = place / file.removeprefix(path).lstrip("/") if file != path else place
            to.parent.mkdir(parents=True, exist_ok=True)
            system.get_file(file, str(to))
    return place


def _located(system: Any, path: str, info: Info) -> Located | None:
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
    """The files of a recording that is a folder, by their paths; of a whole campaign only the recording itself."""
    whole = f"{path.rstrip('/')}/{RECORDING}"
    if kind == "campaign" and system.exists(whole):
        return {whole: system.info(whole)}
    found: dict[str, Info] = system.find(path, detail=True)
    return found


def _of_files(system: Any, path: str, kind: Kind, files: Mapping[str, Info]) -> Located:
    told = [(name.removeprefix(path), info.get("size"), _version(info)) for name, info in sorted(files.items())]
    return Located(
        where=system.unstrip_protocol(path.rstrip("/")),
        kind=kind,
        size=sum(size or 0 for _, size, _ in told),
        stamp=tuple(" ".join(map(str, one)) for one in told) if all(version for *_, version in told) else (),
    )


def _version(info: Info) -> str:
    """What tells versions of a file apart; empty where its filesystem does not say."""
    return next((str(info[name]) for name in _TOLD_BY if info.get(name) is not None), "")
