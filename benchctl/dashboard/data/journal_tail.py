"""The journal of a campaign that runs, read as it grows: each line once."""

from __future__ import annotations

import os
from pathlib import Path

from benchctl.confined import open_file
from benchctl.dashboard.data.journal import Line, event_of
from benchctl.limits import MOST_JOURNAL_BYTES
from benchctl.recordings.schema import JOURNAL


class JournalTail:
    """Reads what is new at each look; of a journal that was replaced, as when a torn line is mended, what was not read.

    `lines` counts those read so far.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / JOURNAL
        self._file = (0, 0)
        self._place = 0
        self.lines = 0

    def new_lines(self) -> list[Line]:
        """The whole lines since the last look; none where there is no journal, or none that can be read."""
        try:
            with open_file(self._path) as file:
                return self._read(file.fileno())
        except OSError:
            return []

    def _read(self, descriptor: int) -> list[Line]:
        stat = os.fstat(descriptor)
        skipped = 0
        if (stat.st_dev, stat.st_ino) != self._file or stat.st_size < self._place:
            skipped = self.lines if stat.st_size >= self._place else 0
            self._file, self._place, self.lines = (stat.st_dev, stat.st_ino), 0, 0
        os.lseek(descriptor, self._place, os.SEEK_SET)
        content = b""
        while self._place + len(content) < min(stat.st_size, MOST_JOURNAL_BYTES):
            more = os.read(descriptor, stat.st_size - self._place - len(content))
            if not more:
                break
            content += more
        whole, _, _ = content.rpartition(b"\n")
        if not whole:
            return []
        self._place += len(whole) + 1
        first = self.lines + 1
        lines = list(enumerate(whole.split(b"\n"), first))
        self.lines += len(lines)
        return [(number, event_of(line)) for number, line in lines if number > skipped]
