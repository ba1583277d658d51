"""Write files and folders atomically: under a temporary name in the same folder, then renamed to the final name."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchctl_instruments.errors import UsageError, in_line

_RESERVE = 32 << 20
"""Bytes that always stay free on the disk: for HDF5's metadata, the journal, and other programs."""


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Convert an `OSError` (no folder, no permission, no space) to a `UsageError` that names `path`."""
    try:
        yield
    except OSError as err:
        # HDF5's own message has several lines of internal details.
        reason = in_line(os.strerror(err.errno) if err.errno else str(err))
        raise UsageError(
            f"{path}: cannot be written: {reason}; check that its folder may be written to and has room"
        ) from err


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to; on success sync it and replace `path` by it, on any error remove it.

    Raises `UsageError` if the disk refuses, or if `path` is a folder, a device or a pipe.
    """
    temporary = temporary_path(path)
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
    """Yield a temporary folder to fill with files; on success rename it to `path`, on any error remove it.

    Raises `UsageError` if `path` exists and is not empty, or if the disk refuses.
    """
    if path.name in ("", ".."):
        raise UsageError(f"{path}: is a folder that cannot be replaced while it is in use; name a new one in it")
    require_empty(path)
    temporary = temporary_path(path)
    with disk_errors(path):
        try:
            temporary.mkdir()
            yield temporary
            for file in temporary.rglob("*"):
                if file.is_file():
                    sync_file(file)
            if path.exists():
                path.rmdir()
            temporary.rename(path)
            sync_folder(path.parent)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


def require_empty(folder: Path) -> None:
    """Raise `UsageError` if the folder to be created exists and is not empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: cannot be created, it is there already and not empty; name another folder")


def refuse_existing(path: Path) -> None:
    """Raise `UsageError` if a non-empty file would be replaced; recordings are never overwritten."""
    if path.is_file() and path.stat().st_size > 0:
        raise UsageError(f"{path}: is there already and is left as it is; name another file or remove it")


def refuse_folder(path: Path) -> None:
    """Raise `UsageError` if the path of an output file is a folder."""
    if path.is_dir():
        raise UsageError(f"{path}: is a folder; name the file to write")


def require_room(path: Path, size: int) -> None:
    """Raise `UsageError` unless the disk of `path` has `size` bytes and a reserve free.

    On a full disk, the HDF5 library may crash the program while the bench is in motion.
    """
    free = shutil.disk_usage(path.parent).free
    if free < size + _RESERVE:
        raise UsageError(
            f"{path}: cannot be written: the disk has {free / 1e6:.0f} MB left, {(size + _RESERVE) / 1e6:.0f} MB are "
            "needed; make room"
        )


def free_bytes(folder: Path) -> int:
    """Return the number of bytes that can be written in a folder, which need not exist yet, without the reserve.

    Raises `UsageError` if a file has the name of the folder or of one of its parents.
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
    """Wait until a folder's entries are on the disk; not available and not needed on Windows."""
    if os.name == "nt":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def temporary_path(path: Path) -> Path:
    """Return a temporary name in the same folder, hence on the same disk, that no reader takes for a recording."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")
