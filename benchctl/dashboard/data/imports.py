"""Open recordings, whose samples are text: imported once, into the cache, and read from there like any other."""

from __future__ import annotations

import threading
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from benchctl.dashboard.data.cached import throw_out
from benchctl.dashboard.data.stored import Stamp
from benchctl.recordings.import_open import DESCRIPTION, read_open_recording, samples_of
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError

MOST_BYTES = 1 << 30
"""What they take in the cache at the most."""

_ENDING = ".h5"


_lock = threading.Lock()


def imported(folder: Path, cache: Path) -> Path:
    """The import of an open recording, which is made where it is not there.

    Raises
    ------
    UsageError
        Where the open recording cannot be read, or its import not be written.
    """
    with _lock:  # whoever comes second finds it there
        place = import_of(folder, cache)
        if not place.exists():
            meta, steps = read_open_recording(folder)
            try:
                place.parent.mkdir(parents=True, exist_ok=True)
            except OSError as err:
                raise UsageError(f"{place.parent}: cannot be made: {err.strerror or err}") from err
            write_recording(place, meta, steps)
            throw_out(place.parent, _ENDING, MOST_BYTES, place)
        return place


def import_of(folder: Path, cache: Path) -> Path:
    """Where the import of an open recording is, or would be; `UsageError` where that holds no samples."""
    stamps = []
    for file in (folder / DESCRIPTION, samples_of(folder)):
        with suppress(OSError):
            stamps.append(f"{file.resolve()} {Stamp.of(file)}")
    name = sha256(repr(stamps).encode("utf-8", "surrogateescape")).hexdigest()[:40]
    return cache / "imports" / f"{name}{_ENDING}"
