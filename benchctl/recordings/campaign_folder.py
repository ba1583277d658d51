"""Writes a recording while it is measured: a folder with a file a step; a crash loses at most the last half second.

```
campaign.h5                   what is known before the first step: a recording without steps
journal.jsonl                 one JSON object a line: what was decided and when
steps/0001_zero.h5            a finished step: closed, compressed, sealed, on the disk
steps/0002_rate_+50.h5.part   the step being written: HDF5 under SWMR, flushed at least every half second
recording.h5                  once the campaign is finished: all steps; campaign.h5 and steps/ are then gone
```
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchctl.atomic import disk_errors, require_empty, sync_file, sync_folder
from benchctl.recordings.combine import combine
from benchctl.recordings.model import Meta, Status, StepInfo
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, JOURNAL, RECORDING, STEPS
from benchctl.recordings.step_writer import StepWriter
from benchctl.recordings.writer import write_recording
from instruments.errors import UsageError

__all__ = ["CampaignWriter", "StepWriter"]


class CampaignWriter:
    """Writes a campaign's folder; one step at a time, each with an index of its own.

    `meta.status` should be `running`. Raises `UsageError` where the folder exists and holds something, or the disk
    refuses.
    """

    def __init__(self, folder: Path, meta: Meta) -> None:
        require_empty(folder)
        self.folder = folder
        self.meta = meta
        self._step: StepWriter | None = None
        with disk_errors(folder):
            (folder / STEPS).mkdir(parents=True)
            (folder / JOURNAL).touch()
        write_recording(folder / CAMPAIGN, meta, ())

    def event(self, kind: str, /, **data: Any) -> None:
        """Append a line to the journal: `kind`, wall time (UTC) and `data` (plain JSON); it survives `kill -9`."""
        line = json.dumps({"kind": kind, "wall_time": datetime.now(UTC).isoformat(), **data}, ensure_ascii=False)
        journal = self.folder / JOURNAL
        with disk_errors(journal), journal.open("a", encoding="utf-8") as file:
            file.write(f"{line}\n")

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
        self._sync_journal()
        return self._step

    def finish(self, status: Status, reason: str = "") -> Path:
        """Gather all steps in `recording.h5`, check every digest in it, remove `steps/`; returns the path of the file.

        A step that is still open is cut. `reason` and the journal are kept as `Meta.provenance["reason"]` and
        `["journal"]`. Raises `UsageError` where that fails; the finished steps then stay as they are.
        """
        self.event("finish", status=status, reason=reason)
        if self._step is not None and self._step.is_open:
            self._step.cut()
        self._sync_journal()
        journal = (self.folder / JOURNAL).read_text(encoding="utf-8")
        provenance = {**self.meta.provenance, "reason": reason, "journal": journal}
        recording = self.folder / RECORDING
        combine(
            sorted((self.folder / STEPS).glob(f"[0-9]*{FINISHED_SUFFIX}")),
            recording,
            replace(self.meta, status=status, provenance=provenance),
        )
        with disk_errors(self.folder):
            shutil.rmtree(self.folder / STEPS)
            (self.folder / CAMPAIGN).unlink()
        return recording

    def release(self) -> None:
        """Let go of every file, leaving the folder as a crash would: it opens, and its status is still `running`."""
        if self._step is not None:
            self._step.release()

    def _sync_journal(self) -> None:
        with disk_errors(self.folder):
            sync_file(self.folder / JOURNAL)
            sync_folder(self.folder)
