"""The guard's own line in a campaign's journal, on the disk at once."""

from __future__ import annotations

import os
from pathlib import Path

from benchctl.atomic import disk_errors
from benchctl.recordings.journal import append_event, sync_journal


def note(journal: Path, **data: object) -> None:
    """Append an event of kind "guard"; raises `UsageError` where the disk refuses.

    A line that the runner had only begun when it died is ended first, so that it spoils no other.
    """
    with disk_errors(journal), journal.open("ab+") as file:
        if file.tell():
            file.seek(-1, os.SEEK_END)
            if file.read() != b"\n":
                file.write(b"\n")
    append_event(journal, "guard", data)
    sync_journal(journal)
