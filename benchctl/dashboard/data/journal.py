"""A campaign's journal, read line by line: that in its folder, or the one that its recording keeps."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import IO, Any

from benchctl.confined import open_file
from benchctl.dashboard.data.kinds import is_open_recording, recording_in
from benchctl.limits import MOST_JOURNAL_BYTES, MOST_LINE_BYTES, require_file
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.hdf5_guard import attribute
from benchctl.recordings.journal import events_in
from benchctl.recordings.schema import JOURNAL
from benchctl_instruments.errors import UsageError

Line = tuple[int, dict[str, Any] | None]
"""The number of a line, from 1, and the event that it is; None where it is none."""


def lines_after(path: Path, number: int) -> Iterator[Line]:
    """The whole lines of a campaign's journal behind line `number`; a last one without its end is left for later.

    Raises `UsageError` where the journal cannot be read.
    """
    with closing(_opened(path)) as file:
        read = 0
        for count, line in enumerate(file, 1):
            read += len(line)
            if not line.endswith(b"\n") or read > MOST_JOURNAL_BYTES:
                return
            if count > number:
                yield count, event_of(line)


def event_of(line: bytes) -> dict[str, Any] | None:
    """The event that a line is; None where it is none."""
    if len(line) > MOST_LINE_BYTES:
        return None
    return next(events_in(line.decode("utf-8", "replace").removesuffix("\n")), None)


def _opened(path: Path) -> IO[bytes]:
    journal = path / JOURNAL
    if path.is_dir():
        require_file(journal, "journal ")
        try:
            return open_file(journal)
        except FileNotFoundError:
            pass
        except OSError as err:
            raise UsageError(f"journal {journal}: cannot be read: {err.strerror or err}") from err
    file = recording_in(path)
    if file is None or is_open_recording(path):
        return io.BytesIO()
    try:
        with open_ours(file) as opened:
            kept = attribute(opened, "provenance_journal", "")
    except ValueError as err:
        raise UsageError(f"{file}: its journal is damaged: {err}") from err
    return io.BytesIO(str(kept).encode("utf-8"))
