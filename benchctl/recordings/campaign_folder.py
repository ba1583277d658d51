"""Write a recording while it is measured, into a folder with one file per step; a crash loses at most half a second.

```
campaign.h5                   the description known before the first step: a recording without steps
journal.jsonl                 one JSON object per line: what was decided and when
running.lock                  held by the process that writes; running.json states which one
stop.json                     a stop request, until it is obeyed (`benchctl.campaign.stop`)
steps/0001_zero.h5            a finished step: closed, compressed, sealed, on the disk
steps/0002_rate_+50.h5.part   the step being written: HDF5 under SWMR, flushed at least every half second
recording.h5                  in a finished campaign: all steps; campaign.h5 and steps/ are then removed
unreadable/                   files of steps that a crash left unreadable, if there are any
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
    """Return the lock of a campaign's folder, not yet acquired."""
    return Lock(folder / LOCK, f"campaign {folder}")


class CampaignWriter:
    """Writes a campaign's folder; one step at a time, each with its own index.

    `meta.status` should be `running`. `lock` is the lock of a folder that is resumed, acquired by the caller; without
    it the folder is created. Raises `UsageError` if a folder to be created exists and is not empty, or the disk
    refuses.
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
        """Create the file of a step with these channels, including their time axes.

        Raises `UsageError` if a step is still open, or a step with this index exists.
        """
        if self._step is not None and self._step.is_open:
            raise UsageError(
                f"step {info.index} cannot begin: step {self._step.info.index} is still open; close or cut it"
            )
        if any((self.folder / STEPS).glob(f"{info.index:04d}_*")):
            raise UsageError(f"{self.folder}: step {info.index} is already there; each step needs a different index")
        self._step = StepWriter(self.folder / STEPS, info, channels, self.meta)
        return self._step

    def step_over(self, info: StepInfo) -> None:
        """Record in the journal that a step is complete; the step and this line are then on the disk."""
        self.event("whole", index=info.index, name=info.name, samples=info.samples, digest=info.digest)
        sync_journal(self.folder / JOURNAL)

    def finish(self, status: Status, reason: str = "") -> Path:
        """Gather all steps in `recording.h5`, check every digest in it, remove `steps/`; return the path of the file.

        A step that is still open is cut. `reason` and the journal are stored as `Meta.provenance["reason"]` and
        `["journal"]`. Raises `UsageError` if this fails; the finished steps then remain unchanged.
        """
        self.event("finish", status=status, reason=reason)
        if self._step is not None and self._step.is_open:
            self._step.cut()
        recording = gather(self.folder, self.meta, status, reason)
        self._lock.release()
        return recording

    def release(self) -> None:
        """Close every file and release the lock; the folder is left as after a crash: it opens, and can be resumed."""
        try:
            if self._step is not None:
                self._step.release()
        finally:
            self._lock.release()


def _make(folder: Path, meta: Meta) -> Lock:
    """Create a campaign's folder without steps, and acquire its lock."""
    require_empty(folder)
    with disk_errors(folder):
        (folder / STEPS).mkdir(parents=True)  # if two programs do this at once, the second fails here
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
