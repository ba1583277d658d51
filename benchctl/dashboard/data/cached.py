"""Files of blocks in the cache: each whole or not there, named by what it was made from; the oldest go first.

    | "benchctl-blocks/1", with 0 up to 24 | rows 8 | CRC-32 of the rows 4 | 0 4 | key 32 | rows of 5 float64 ... |

All numbers are little-endian. A file that is damaged, or of another key, is as good as none: it is made anew.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import IO

import numpy as np

from benchctl.dashboard.data.envelope import COLUMNS
from benchctl_instruments.arrays import FloatArray

MOST_BYTES = 2 << 30
"""What the overviews take in the cache at the most."""

ENDING = ".blocks"
_HEAD = struct.Struct("<24sQI4x32s")
_FORMAT = b"benchctl-blocks/1"
_ROW = 8 * COLUMNS
_AT_ONCE = 1 << 16
"""Rows that are looked at at once, 2.5 MiB."""


class BlockFile:
    """Blocks in a file of the cache, `rows` of them; any thread may read while one appends.

    What disk and system refuse is an OSError.
    """

    nbytes = 0
    """What they take in memory."""

    def __init__(self, path: Path, rows: int = 0) -> None:
        self.path, self.rows = path, rows
        self._file: IO[bytes] | None = None
        self._crc = 0

    def read(self, first: int, end: int) -> FloatArray:
        """Blocks, shape (end - first, 5)."""
        with self.path.open("rb") as file:
            file.seek(_HEAD.size + first * _ROW)
            content = file.read((end - first) * _ROW)
        if len(content) < (end - first) * _ROW:
            raise OSError(f"{self.path}: was cut short")
        return np.frombuffer(content, dtype="<f8").reshape(-1, COLUMNS)

    def append(self, rows: FloatArray) -> None:
        """Add blocks, shape (n, 5), to a file that is being made."""
        if self._file is None:
            raise OSError(f"{self.path}: is finished")
        content = np.ascontiguousarray(rows, dtype="<f8").tobytes()
        self._file.write(content)
        self._file.flush()
        self._crc = zlib.crc32(content, self._crc)
        self.rows += len(rows)

    def begin(self, file: IO[bytes]) -> None:
        """Leave room for the head of a file that is to be made."""
        self._file = file
        file.write(bytes(_HEAD.size))

    def finish(self, key: bytes) -> None:
        """Say what is in it, once it is all there."""
        if self._file is not None:
            self._file.seek(0)
            self._file.write(_HEAD.pack(_FORMAT, self.rows, self._crc, key))
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file = None


class Cache:
    """A folder of such files, which holds `most_bytes` at the most."""

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES) -> None:
        self._folder, self._most_bytes = folder, most_bytes

    def find(self, name: str) -> BlockFile | None:
        """The file that was made under this name; None where there is none, or it is damaged."""
        path, key = self._place(name)
        try:
            with path.open("rb") as file:
                head = file.read(_HEAD.size)
                told, rows, crc, said = _HEAD.unpack(head)
                if told.rstrip(b"\0") != _FORMAT or said != key or _crc(file, rows) != crc:
                    raise ValueError("is damaged")
            os.utime(path)  # it was of use: others go before it
        except (OSError, ValueError, struct.error):
            return None
        return BlockFile(path, rows)

    @contextmanager
    def making(self, name: str) -> Iterator[BlockFile]:
        """A file to be filled; it is there, under this name, once the block has ended without an error.

        Raises OSError where the disk refuses.
        """
        path, key = self._place(name)
        self._folder.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        try:
            with temporary.open("wb") as file:
                made = BlockFile(temporary)
                made.begin(file)
                yield made
                made.finish(key)
            temporary.replace(path)
            made.path = path
        finally:
            temporary.unlink(missing_ok=True)
        throw_out(self._folder, ENDING, self._most_bytes, path)

    def _place(self, name: str) -> tuple[Path, bytes]:
        key = sha256(name.encode("utf-8", "surrogateescape")).digest()
        return self._folder / f"{key.hex()[:40]}{ENDING}", key


def throw_out(folder: Path, ending: str, most_bytes: int, newest: Path) -> None:
    """Remove the files that were of no use for longest until the rest is small enough, but never the newest.

    What a crash left half-made is counted, too, and goes in its turn.
    """
    files = []
    for path in folder.glob(f"*{ending}*"):
        with suppress(OSError):
            stat = path.stat()
            files.append((path != newest, -stat.st_mtime_ns, stat.st_size, path))
    room = most_bytes
    for is_other, _, size, path in sorted(files):
        room -= size
        if room < 0 and is_other:
            with suppress(OSError):
                path.unlink()


def _crc(file: IO[bytes], rows: int) -> int:
    """The CRC of the rows that follow; ValueError where there are not so many, or more."""
    crc, left = 0, rows * _ROW
    while left:
        content = file.read(min(left, _AT_ONCE * _ROW))
        if not content:
            raise ValueError("is cut short")
        crc, left = zlib.crc32(content, crc), left - len(content)
    if file.read(1):
        raise ValueError("is longer than it says")
    return crc
