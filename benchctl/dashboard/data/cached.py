"""Cache files of blocks: written atomically, named by their source; the oldest are removed first.

    | "benchctl-blocks/1", with 0 up to 24 | rows 8 | CRC-32 of the rows 4 | 0 4 | key 32 | rows of 5 float64 ... |

All numbers are little-endian. A file that is damaged, or has another key, is ignored and replaced.
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
"""Maximum size of the cached overviews."""

ENDING = ".blocks"
_HEAD = struct.Struct("<24sQI4x32s")
_FORMAT = b"benchctl-blocks/1"
_ROW = 8 * COLUMNS
_AT_ONCE = 1 << 16
"""Rows that are checked at once, 2.5 MiB."""


class BlockFile:
    """Blocks in a file of the cache, `rows` of them; any thread may read while one appends.

    Errors of the disk and the system are OSErrors.
    """

    nbytes = 0
    """Memory used by the blocks."""

    def __init__(self, path: Path, rows: int = 0) -> None:
        self.path, self.rows = path, rows
        self._file: IO[bytes] | None = None
        self._crc = 0

    def read(self, first: int, end: int) -> FloatArray:
        """Return blocks, shape (end - first, 5)."""
        with self.path.open("rb") as file:
            file.seek(_HEAD.size + first * _ROW)
            content = file.read((end - first) * _ROW)
        if len(content) < (end - first) * _ROW:
            raise OSError(f"{self.path}: was cut short")
        return np.frombuffer(content, dtype="<f8").reshape(-1, COLUMNS)

    def append(self, rows: FloatArray) -> None:
        """Append blocks, shape (n, 5), to an unfinished file."""
        if self._file is None:
            raise OSError(f"{self.path}: is finished")
        content = np.ascontiguousarray(rows, dtype="<f8").tobytes()
        self._file.write(content)
        self._file.flush()
        self._crc = zlib.crc32(content, self._crc)
        self.rows += len(rows)

    def begin(self, file: IO[bytes]) -> None:
        """Reserve space for the header of a new file."""
        self._file = file
        file.write(bytes(_HEAD.size))

    def finish(self, key: bytes) -> None:
        """Write the header of a complete file."""
        if self._file is not None:
            self._file.seek(0)
            self._file.write(_HEAD.pack(_FORMAT, self.rows, self._crc, key))
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file = None


class Cache:
    """A folder of such files with a total size of at most `most_bytes`."""

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES) -> None:
        self._folder, self._most_bytes = folder, most_bytes

    def find(self, name: str) -> BlockFile | None:
        """Return the file stored under this name; None if there is none, or if it is damaged."""
        path, key = self._place(name)
        try:
            with path.open("rb") as file:
                head = file.read(_HEAD.size)
                magic, rows, crc, stored_key = _HEAD.unpack(head)
                if magic.rstrip(b"\0") != _FORMAT or stored_key != key or _crc(file, rows) != crc:
                    raise ValueError("is damaged")
            os.utime(path)  # mark as recently used: others are removed first
        except (OSError, ValueError, struct.error):
            return None
        return BlockFile(path, rows)

    @contextmanager
    def making(self, name: str) -> Iterator[BlockFile]:
        """Create a file to be filled; it is stored under this name when the block has ended without an error.

        Raises OSError on errors of the disk.
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
    """Remove the least recently used files until the total size is small enough, but never the newest.

    Incomplete files left by a crash are included.
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
    """Return the CRC of the following rows; ValueError if there are fewer or more."""
    crc, left = 0, rows * _ROW
    while left:
        content = file.read(min(left, _AT_ONCE * _ROW))
        if not content:
            raise ValueError("is cut short")
        crc, left = zlib.crc32(content, crc), left - len(content)
    if file.read(1):
        raise ValueError("is longer than it says")
    return crc
