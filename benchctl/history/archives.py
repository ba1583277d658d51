"""Unpack the recordings and documents of an archive of campaigns safely into a temporary folder.

A zip or tar may contain paths outside the folder, links, a terabyte in a kilobyte, or a million names. Only regular
members that are recordings or documents are unpacked, by their contents and not by their headers, and not more than the
archive's own size allows.
"""

from __future__ import annotations

import gzip
import io
import lzma
import re
import struct
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, cast

from benchctl.atomic import free_bytes
from benchctl.history.index import is_wanted
from benchctl.limits import FREE_BYTES, MOST_DESCRIPTION_BYTES, MOST_TEXT_INFLATION, shown
from benchctl_instruments.errors import UsageError, in_line, reason

_MOST_MEMBERS = 1 << 17
"""Maximum number of names in an archive: ten thousand campaigns with their accompanying files."""
_PIECE = 1 << 20
_DRIVE = re.compile(r"[A-Za-z]:")
_DAMAGE = (
    *(zipfile.BadZipFile, tarfile.TarError, EOFError, zlib.error, lzma.LZMAError, struct.error),
    *(ValueError, RuntimeError, NotImplementedError, OSError),
)
"""Exceptions of the standard library for archives that are damaged, encrypted, or packed by an unsupported method."""


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Unpack a .zip, .tar or .tar.gz to a temporary folder, which is removed at the end of the block.

    Raises
    ------
    UsageError
        If it is not an archive, is damaged, contains an absolute path, a path with `..`, a link in place of a
        recording, or a duplicate name, or unpacks to more than its size or the disk allows.
    """
    with tempfile.TemporaryDirectory(prefix="benchctl-history-") as name:
        folder = Path(name)
        try:
            budget = _Budget(path, min(FREE_BYTES + MOST_TEXT_INFLATION * path.stat().st_size, free_bytes(folder)))
            with path.open("rb", buffering=0) as raw, _Archive(raw) as file:
                _unpack(path, file, folder, budget)
        except UsageError:
            raise
        except _DAMAGE as err:
            why = reason(err) if isinstance(err, OSError) else in_line(str(err) or type(err).__name__)
            raise UsageError(f"{path}: cannot be unpacked: {why}; copy or pack it again") from err
        yield folder


class _Budget:
    """The number of bytes that may still be unpacked."""

    def __init__(self, path: Path, most: int) -> None:
        self._path, self._most, self._left = path, most, most

    def take(self, count: int) -> None:
        self._left -= count
        self.require(0)

    def require(self, count: int) -> None:
        """Raise `UsageError` if fewer than `count` bytes remain."""
        if count > self._left:
            raise UsageError(
                f"{self._path}: unpacks to more than {self._most / 1e6:.0f} MB, which its size or the disk for "
                "temporary files does not allow; unpack it by hand if you trust it, and name the folder"
            )


class _Sequential(io.RawIOBase):
    """A tar, compressed or not, read once in order and in small pieces, whatever its headers claim."""

    def __init__(self, file: IO[bytes], budget: _Budget) -> None:
        self._file, self._budget = file, budget

    def read(self, size: int = -1) -> bytes:
        if not 0 <= size <= MOST_DESCRIPTION_BYTES:
            raise ValueError(f"a header claims {size} bytes")
        content = self._file.read(size)
        self._budget.take(len(content))
        return content

    def tell(self) -> int:
        return self._file.tell()

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        ahead = offset - self._file.tell()
        if whence != io.SEEK_SET or ahead < 0:
            raise ValueError("its members overlap")
        self._budget.take(ahead)
        return self._file.seek(offset)


class _Archive(io.BufferedReader):
    """An archive that limits the size of a zip's member list, which is read into memory completely."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > MOST_DESCRIPTION_BYTES:
            raise ValueError(f"its directory claims {size} bytes")
        return super().read(size)


def _unpack(path: Path, file: _Archive, folder: Path, budget: _Budget) -> None:
    start = file.read(4)
    file.seek(0)
    if start[:2] == b"\x1f\x8b":
        with gzip.GzipFile(fileobj=file) as inflated:
            _unpack_tar(cast("IO[bytes]", inflated), folder, budget)
    elif start[:2] == b"PK":
        _unpack_zip(file, folder, budget)
    elif path.suffix.lower() == ".tar":
        _unpack_tar(file, folder, budget)
    else:
        raise UsageError(f"{path}: is no folder and no archive; expected a folder of campaigns, .zip, .tar or .tar.gz")


def _unpack_zip(file: _Archive, folder: Path, budget: _Budget) -> None:
    with zipfile.ZipFile(file) as archive:
        for count, member in enumerate(archive.infolist()):
            target = _target(folder, member.filename, count)
            if target is None or member.is_dir():
                continue
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"{shown(member.filename)} is packed in another way than deflate")
            with archive.open(member) as content:
                _copy(content, target, budget)


def _unpack_tar(file: IO[bytes], folder: Path, budget: _Budget) -> None:
    sequential = cast("IO[bytes]", _Sequential(file, budget))
    with tarfile.open(fileobj=sequential, mode="r:") as archive:
        for count, member in enumerate(archive):
            target = _target(folder, member.name, count)
            if target is None or member.isdir():
                continue
            content = archive.extractfile(member) if member.isreg() and not member.issparse() else None
            if content is None:
                raise ValueError(f"{shown(member.name)} is no plain file but a link or worse")
            budget.require(member.size)
            _copy(content, target, None)


def _target(folder: Path, name: str, count: int) -> Path | None:
    """Return a member's target; None if it is not needed. Raises ValueError for an unsafe path."""
    if count >= _MOST_MEMBERS:
        raise ValueError(f"it has more than {_MOST_MEMBERS} members")
    parts = PurePosixPath(name).parts
    if name.startswith("/") or "\\" in name or ".." in parts or _DRIVE.match(name) or "\0" in name:
        raise ValueError(f"{shown(name)} leads out of the archive")
    return folder.joinpath(*parts) if parts and is_wanted(parts[-1]) else None


def _copy(content: IO[bytes], target: Path, budget: _Budget | None) -> None:
    """Write a member's bytes; `budget` is None if reading them already reduces it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.exists():
        raise ValueError(f"it holds {shown(target.name)} twice in one place")
    with target.open("xb") as file:
        while piece := content.read(_PIECE):
            if budget is not None:
                budget.take(len(piece))
            file.write(piece)
