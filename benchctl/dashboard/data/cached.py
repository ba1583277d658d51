"""Cache files of blocks: in numpy's format, named by their source; the least recently used are removed first."""

from __future__ import annotations

import os
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

import numpy as np

from benchctl.atomic import whole_file
from benchctl.dashboard.data.envelope import COLUMNS
from benchctl_instruments.arrays import FloatArray

MOST_BYTES = 2 << 30
"""Maximum size of the cached overviews."""

ENDING = ".blocks"


class Cache:
    """A folder of such files with a total size of at most `most_bytes`."""

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES) -> None:
        self._folder, self._most_bytes = folder, most_bytes

    def find(self, name: str) -> FloatArray | None:
        """Return the blocks stored under this name, mapped, shape (n, 5); None if there are none, or no such ones."""
        path = self._place(name)
        try:
            rows = np.lib.format.open_memmap(path, mode="r")
            os.utime(path)  # mark as recently used: others are removed first
        except (OSError, ValueError):
            return None
        return rows if rows.dtype == np.float64 and rows.shape[1:] == (COLUMNS,) else None

    def store(self, name: str, rows: FloatArray) -> None:
        """Store blocks, shape (n, 5), under this name; raises `UsageError` or OSError if the disk refuses."""
        path = self._place(name)
        self._folder.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as temporary, temporary.open("wb") as file:
            np.save(file, rows)
        throw_out(self._folder, ENDING, self._most_bytes, path)

    def _place(self, name: str) -> Path:
        key = sha256(name.encode("utf-8", "surrogateescape")).hexdigest()
        return self._folder / f"{key[:40]}{ENDING}"


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
