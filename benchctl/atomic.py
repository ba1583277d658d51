"""Files that are there and whole or not at all: written under a temporary name beside, then renamed into place."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchctl_instruments.errors import UsageError, in_line

_RESERVE = 32 << 20
"""Bytes that are always left on the disk: for HDF5's own records, the journal, and other programs."""


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn what the disk refuses (no folder, no permission, no space) into a `UsageError` that names `path`."""
    try:
        yield
    except OSError as err:
        # HDF5's own text spans lines and speaks of symbol tables.
        reason = in_line(os.strerror(err.errno) if err.errno else str(err))
        raise UsageError(
            f"{path}: cannot be written: {reason}; check that its folder may be written to and has room"
        ) from err


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary name to write to; on success synced and renamed to `path`, replacing it, on any error removed.

    Raises `UsageError` where the disk refuses, or `path` is a folder, a device or a pipe.
    """
    temporary = beside(path)
    with disk_errors(path):
        if path.exists() and not path.is_file():
            raise UsageError(f"{path}: cannot be written: it is there already and no file; name a file")
        try:
            yield temporary
            sync_file(temporary)
            temporary.replace(path)
            sync_folder(path.parent)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder to fill with files; on success renamed to `path`, on any error removed.

    Raises `UsageError` where `path` holds something already, or where the disk refuses.
    """
    if path.name in ("", ".."):
        raise UsageError(f"{path}: is a folder that cannot be replaced while it is in use; name a new one in it")
    require_empty(path)
    temporary = beside(path)
    with disk_errors(path):
        try:
            temporary.mkdir()
            yield temporary
            for file in temporary.iterdir():
                sync_file(file)
            if path.exists():
                path.rmdir()
            temporary.rename(path)
            sync_folder(path.parent)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


def require_empty(folder: Path) -> None:
    """Raise `UsageError` where the folder to be created is there already and holds something."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: cannot be created, it is there already and not empty; name another folder")


def require_room(path: Path, size: int) -> None:
    """Raise `UsageError` where the disk that holds `path` has not `size` bytes left, and a reserve.

    HDF5 must not meet a full disk: its library then may end the whole program, with the bench in motion.
    """
    free = shutil.disk_usage(path.parent).free
    if free < size + _RESERVE:
        raise UsageError(
            f"{path}: cannot be written: the disk has {free / 1e6:.0f} MB left, {(size + _RESERVE) / 1e6:.0f} MB are "
            "needed; make room"
        )


def free_bytes(folder: Path) -> int:
    """What may still be written at a folder, which need not be there yet, without the reserve.

    Raises `UsageError` where a file is in the way.
    """
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise UsageError(f"{folder}: cannot be created, {place} is a file; name another folder")
    return max(0, shutil.disk_usage(place).free - _RESERVE)


def sync_file(path: Path) -> None:
    """Wait until a file's bytes are on the disk."""
    descriptor = os.open(path, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_folder(path: Path) -> None:
    """Wait until a folder's entries are on the disk; Windows has no such call and needs none."""
    if os.name == "nt":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def beside(path: Path) -> Path:
    """A name in the same folder, hence on the same disk, that no reader takes for a recording."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")
