"""From a campaign's folder to the one file that people keep."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from benchctl.atomic import disk_errors, sync_folder
from benchctl.recordings.combine import Begun, combine
from benchctl.recordings.journal import journal_text, sync_journal
from benchctl.recordings.model import Meta, Status
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, JOURNAL, RECORDING, STEPS
from benchctl_instruments.errors import UsageError


def finished_steps(folder: Path) -> list[Path]:
    """The files of a campaign's finished steps, in the order of their indices."""
    return sorted((folder / STEPS).glob(f"[0-9]*{FINISHED_SUFFIX}"))


def gather(folder: Path, meta: Meta, status: Status, reason: str, begun: Begun | None = None) -> Path:
    """Gather all finished steps in `recording.h5`, check every digest in it, remove their files; returns its path.

    `reason` and the journal are kept as `Meta.provenance["reason"]` and `["journal"]`. What was `begun` is gone on with
    where it can be, and removed. Raises `UsageError` where that fails; the steps then stay as they are.
    """
    sync_journal(folder / JOURNAL)
    provenance = {**meta.provenance, "reason": reason, "journal": journal_text(folder / JOURNAL)}
    recording = folder / RECORDING
    told = replace(meta, status=status, provenance=provenance)
    files = finished_steps(folder)
    if begun is None or not _completed(files, recording, told, begun):
        combine(files, recording, told)
    remove_gathered(folder, files)
    return recording


def _completed(files: list[Path], recording: Path, meta: Meta, begun: Begun) -> bool:
    """Whether what was begun could become the recording; where it could not, for any reason, there is none."""
    try:
        if tuple(file.name for file in files[: len(begun.files)]) != begun.files:
            return False
        combine(files, recording, meta, begun)
    except (UsageError, LookupError, RuntimeError, ValueError):  # as HDF5 words it that a file is damaged
        return False
    finally:
        begun.path.unlink(missing_ok=True)
    return True


def remove_gathered(folder: Path, files: Iterable[Path]) -> None:
    """Remove the files of steps that `recording.h5` holds, all of whose digests were checked, and `campaign.h5`."""
    with disk_errors(folder):
        for file in files:
            file.unlink()
        with suppress(OSError):  # it holds something else, or is not there
            (folder / STEPS).rmdir()
        (folder / CAMPAIGN).unlink(missing_ok=True)
        sync_folder(folder)
