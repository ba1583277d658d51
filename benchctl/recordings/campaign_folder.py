"""Writes a recording while it is measured: a folder with a file a step; a crash loses at most the last half second.

```
campaign.h5                   what is known before the first step: a recording without steps
journal.jsonl                 one JSON object a line: what was decided and when
running.lock                  held by the process that writes; running.json says which that is
stop.json                     somebody's wish to stop it, until it is heeded (`benchctl.campaign.stop`)
steps/0001_zero.h5            a finished step: closed, compressed, sealed, on the disk
steps/0002_rate_+50.h5.part   the step being written: HDF5 under SWMR, flushed at least every half second
recording.h5                  once the campaign is finished: all steps; campaign.h5 and steps/ are then gone
unreadable/                   files of steps that a crash left unreadable, where there were any
```
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchctl.atomic import disk_errors, require_empty, sync_folder
from benchctl.locks import Lock
from benchctl.recordings.gather import gather
from benchctl.recordings.journal import append_event, sync_journal
from benchctl.recordings.model import Meta, Status, StepInfo
from benchctl.recordings.schema import CAMPAIGN, JOURNAL, LOCK, STEPS
from benchctl.recordings.step_writer import StepWriter
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError

__all__ = ["CampaignWriter", "StepWriter"]


def campaign_lock(folder: Path) -> Lock:
    """The lock of a campaign's folder, not yet taken."""
    return Lock(folder / LOCK, f"campaign {folder}")


class CampaignWriter:
    """Writes a campaign's folder; one step at a time, each with its own index.

    `meta.status` should be `running`. `lock` is that of a folder which is gone on with, taken by the caller; without it
    the folder is made. Raises `UsageError` where a folder to be made exists and holds something, or the disk refuses.
    """

    def __init__(self, folder: Path, meta: Meta, lock: Lock | None = None) -> None:
        self.folder = folder
        self.meta = meta
        self._step: StepWriter | None = None
        self._lock = _make(folder, meta) if lock is None else lock

    def event(self, kind: str, /, **data: Any) -> None:
        """Append a line to the journal: `kind`, wall time (UTC) and `data` (plain JSON); it survives `kill -9`."""
        append_event(self.folder / JOURNAL, kind, data)

    def begin_step(self, info: StepInfo, channels: Sequence[str]) -> StepWriter:
        """Begin the file of a step that will hold these channels, their time axes among them.

        Raises `UsageError` where a step is still open, or one with this index is there.
        """
        if self._step is not None and self._step.is_open:
            raise UsageError(
                f"step {info.index} cannot begin: step {self._step.info.index} is still open; close or cut it"
            )
        if any((self.folder / STEPS).glob(f"{info.index:04d}_*")):
            raise UsageError(f"{self.folder}: step {info.index} is already there; every step needs an index of its own")
        self._step = StepWriter(self.folder / STEPS, info, channels, self.meta)
        return self._step

    def step_over(self, info: StepInfo) -> None:
        """Note that a step is complete; the step and its line in the journal are then on the disk."""
        self.event("whole", index=info.index, name=info.name, samples=info.samples, digest=info.digest)
        sync_journal(self.folder / JOURNAL)

    def finish(self, status: Status, reason: str = "") -> Path:
        """Gather all steps in `recording.h5`, check every digest in it, remove `steps/`; returns the path of the file.

        A step that is still open is cut. `reason` and the journal are kept as `Meta.provenance["reason"]` and
        `["journal"]`. Raises `UsageError` where that fails; the finished steps then stay as they are.
        """
        self.event("finish", status=status, reason=reason)
        if self._step is not None and self._step.is_open:
            self._step.cut()
        recording = gather(self.folder, self.meta, status, reason)
        self._lock.release()
        return recording

    def release(self) -> None:
        """Close every file and release the lock, leaving the folder as a crash would: it opens, and can be resumed."""
        try:
            if self._step is not None:
                self._step.release()
        finally:
            self._lock.release()


def _make(folder: Path, meta: Meta) -> Lock:
    """Make a campaign's folder without steps, and take its lock."""
    require_empty(folder)
    with disk_errors(folder):
        (folder / STEPS).mkdir(parents=True)  # of two programs at once the second fails here
    lock = campaign_lock(folder)
    lock.acquire("recording")
    try:
        with disk_errors(folder):
            (folder / JOURNAL).touch()
        write_recording(folder / CAMPAIGN, meta, ())
        with disk_errors(folder):
            sync_folder(folder.parent)
    except BaseException:
        lock.release()
        raise
    return lock
