"""From a campaign's folder to the one file that people keep."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from benchctl.atomic import disk_errors, sync_folder
from benchctl.recordings.combine import combine
from benchctl.recordings.journal import journal_text, sync_journal
from benchctl.recordings.model import Meta, Status
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, JOURNAL, RECORDING, STEPS


def finished_steps(folder: Path) -> list[Path]:
    """The files of a campaign's finished steps, in the order of their indices."""
    return sorted((folder / STEPS).glob(f"[0-9]*{FINISHED_SUFFIX}"))


def gather(folder: Path, meta: Meta, status: Status, reason: str) -> Path:
    """Gather all finished steps in `recording.h5`, check every digest in it, remove their files; returns its path.

    `reason` and the journal are kept as `Meta.provenance["reason"]` and `["journal"]`. Raises `UsageError` where that
    fails; the steps then stay as they are.
    """
    sync_journal(folder / JOURNAL)
    provenance = {**meta.provenance, "reason": reason, "journal": journal_text(folder / JOURNAL)}
    recording = folder / RECORDING
    combine(finished_steps(folder), recording, replace(meta, status=status, provenance=provenance))
    remove_gathered(folder)
    return recording


def remove_gathered(folder: Path) -> None:
    """Remove what `recording.h5`, which must be there, has made superfluous."""
    with disk_errors(folder):
        if (folder / STEPS).exists():
            shutil.rmtree(folder / STEPS)
        (folder / CAMPAIGN).unlink(missing_ok=True)
        sync_folder(folder)
