"""Recordings named by globs: what of all that a pattern matches is a recording, each once."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchctl.limits import listed
from benchctl.recordings.reader import OPEN_DESCRIPTION
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, RECORDING, STEPS, UNREADABLE
from benchctl_instruments.errors import UsageError, reason

Kind = Literal["file", "campaign", "open"]

_MARKS: dict[str, Kind] = {RECORDING: "campaign", CAMPAIGN: "campaign", OPEN_DESCRIPTION: "open"}
"""The files that make a folder a recording, and of which kind; the first one that is there decides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Located:
    """A recording: an absolute path or a URL. `size` is in bytes.

    `stamp` is what its files' directory entries say (name, size, time of change): where that is the same, so is the
    recording; where it is not, or there is none, the content may be the same all the same.
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
        """Its name without its way, and without the suffix that all recordings have."""
        return self.where.partition("::")[0].rpartition("/")[2].removesuffix(FINISHED_SUFFIX)


def is_url(text: str) -> bool:
    """Whether a text is a URL, and not a path."""
    return "://" in text


def located(globs: Sequence[str]) -> tuple[list[Located], list[str]]:
    """The recordings that paths, patterns and URLs name, each once, sorted; and paths and URLs that name none.

    Of a campaign's folder the files in it are not recordings by themselves. What else a pattern matches is left out.

    Raises
    ------
    UsageError
        Where one of them matches nothing, or none of the matches is a recording.
    """
    found: dict[str, Located] = {}
    others: list[str] = []
    for text in globs:
        matches = _remote(text) if is_url(text) else _local(text)
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
    """Which kind of recording a folder is that holds files of these names; None for none."""
    there = set(names)
    return next((kind for mark, kind in _MARKS.items() if mark in there), None)


def owner_of(way: Sequence[str]) -> int:
    """How many parts of a file's way name the recording that it belongs to; 0 where it is part of none by its name.

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
    """The files that a local recording consists of."""
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


def _remote(text: str) -> Iterator[tuple[str, Located | None]]:
    from benchctl.fleet.remote import remote_matches

    return remote_matches(text)
