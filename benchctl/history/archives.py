"""Unpack the recordings and documents of an archive of campaigns into a temporary folder."""

from __future__ import annotations

import shutil
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PureWindowsPath

from benchctl.atomic import free_bytes
from benchctl.history.index import is_wanted
from benchctl.limits import FREE_BYTES, MOST_TEXT_INFLATION, shown
from benchctl_instruments.errors import UsageError, in_line, reason


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Unpack a .zip, .tar or .tar.gz to a temporary folder, which is removed at the end of the block.

    Raises
    ------
    UsageError
        If it is not an archive, is damaged, contains an absolute path, a path with `..`, or a link in place of a
        recording, or unpacks to more than its size or the disk allows.
    """
    with tempfile.TemporaryDirectory(prefix="benchctl-history-") as name:
        try:
            _unpack(path, Path(name))
        except UsageError:
            raise
        except Exception as err:  # damaged archives make the standard library raise almost anything
            why = reason(err) if isinstance(err, OSError) else in_line(str(err) or type(err).__name__)
            raise UsageError(f"{path}: cannot be unpacked: {why}; copy or pack it again") from err
        yield Path(name)


def _unpack(path: Path, folder: Path) -> None:
    most_bytes = min(FREE_BYTES + MOST_TEXT_INFLATION * path.stat().st_size, free_bytes(folder))
    size = 0
    for name, member_size, is_plain, extract in _members(path, folder):
        size += member_size
        if size > most_bytes:
            raise UsageError(
                f"{path}: unpacks to more than {most_bytes / 1e6:.0f} MB, which its size or the disk for temporary "
                "files does not allow; if you trust it, unpack it and name the folder"
            )
        place = PureWindowsPath(name)  # it knows drives and both separators
        if place.anchor or ".." in place.parts:
            raise ValueError(f"{shown(name)} leads out of the archive")
        if is_wanted(place.name):
            if not is_plain:
                raise ValueError(f"{shown(name)} is no plain file but a link or worse")
            extract()


def _members(path: Path, folder: Path) -> Iterator[tuple[str, int, bool, Callable[[], object]]]:
    """Yield of each member but folders its name, its bytes, whether it is a regular file, and what extracts it."""
    with path.open("rb") as file:
        start = file.read(2)
    if start == b"PK":
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                if not info.is_dir():
                    yield info.filename, info.file_size, True, partial(archive.extract, info, folder)
    elif start == b"\x1f\x8b" or path.suffix.lower() == ".tar":
        with tarfile.open(path) as tar:
            for member in tar:
                if not member.isdir():
                    yield member.name, member.size, member.isreg(), partial(_extract, tar, member, folder)
    else:
        raise UsageError(f"{path}: is no folder and no archive; expected a folder of campaigns, .zip, .tar or .tar.gz")


def _extract(tar: tarfile.TarFile, member: tarfile.TarInfo, folder: Path) -> None:
    """Write a regular file; Python 3.11.3 and older have no filters that keep the owner and the mode out."""
    target = folder / member.name
    target.parent.mkdir(parents=True, exist_ok=True)
    source = tar.extractfile(member)
    with target.open("wb") as file:
        shutil.copyfileobj(source, file)  # type: ignore[arg-type]  # None is for what is no regular file
