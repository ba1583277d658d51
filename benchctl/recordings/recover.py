"""Closes the recording of a campaign whose program died: says what is whole, marks what was cut."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchctl.limits import listed
from benchctl.recordings.campaign_folder import campaign_lock
from benchctl.recordings.campaign_manifest import MANIFEST, write_manifest
from benchctl.recordings.campaign_state import described, require_campaign
from benchctl.recordings.gather import finished_steps, gather, remove_gathered
from benchctl.recordings.hdf5_files import RecordingFile
from benchctl.recordings.hdf5_trial import note_ended
from benchctl.recordings.journal import (
    append_event,
    events_in,
    journal_text,
    last_word,
    planned_steps,
)
from benchctl.recordings.model import Status, StepInfo
from benchctl.recordings.schema import CAMPAIGN, JOURNAL, LOCK, RECORDING, STEPS, UNREADABLE
from benchctl.recordings.torn import described_step, gathered_files, put_in_order, put_recording_aside, remove_leftovers


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """A campaign whose recording is closed; `was_closed`: it was so before. `unreadable` files were put aside."""

    recording: Path
    status: Status
    reason: str
    steps: tuple[StepInfo, ...]
    unreadable: tuple[Path, ...]
    was_closed: bool

    @property
    def whole(self) -> int:
        """How many steps are whole."""
        return sum(info.whole for info in self.steps)


def recover(folder: Path) -> Recovered:
    """Gather what a campaign whose program died has recorded in `recording.h5`, and write the folder's manifest.

    Does nothing where that was done. The step that was being written becomes a cut one. Where `recording.h5` is damaged
    and there are steps, they are gathered again. Nothing is removed before every digest of what replaces it was
    checked, so that it may die itself and be called again. Raises `UsageError` where the campaign is being written, the
    folder holds none, a damaged recording is all there is, or the disk refuses.
    """
    require_campaign(folder)
    was_closed = (folder / RECORDING).exists()
    begun = (folder / STEPS).exists() or (folder / CAMPAIGN).exists()
    unfinished = begun or not was_closed or not (folder / MANIFEST).exists()
    if unfinished or (folder / LOCK).exists():  # a death as the last thing was done leaves the lock's files
        lock = campaign_lock(folder)
        lock.acquire("benchctl recover")
        note_ended(folder)
        try:
            remove_leftovers(folder)
            if unfinished:
                was_closed = _finish(folder)
        finally:
            lock.release()
    file = RecordingFile(folder / RECORDING)
    file.close()
    return Recovered(
        recording=folder / RECORDING,
        status=file.meta.status,
        reason=file.meta.provenance.get("reason", ""),
        steps=file.infos,
        unreadable=tuple(sorted((folder / UNREADABLE).glob("*"))),
        was_closed=was_closed,
    )


def _finish(folder: Path) -> bool:
    """Whether the recording was there."""
    gathered = gathered_files(folder)
    if gathered is None:
        _close(folder)
    else:
        remove_gathered(folder, gathered)
    write_manifest(folder)
    return gathered is not None


def _close(folder: Path) -> None:
    put_recording_aside(folder)
    meta = described(folder)
    journal = journal_text(folder / JOURNAL)
    put_in_order(folder, meta)
    status, reason = _how_it_ended(journal, folder)
    append_event(folder / JOURNAL, "recover", {"status": status, "reason": reason})
    gather(folder, meta, status, reason)


def _how_it_ended(journal: str, folder: Path) -> tuple[Status, str]:
    """As the program said, but complete where, and only where, every planned step is whole."""
    status, reason = last_word(events_in(journal))
    planned = planned_steps(events_in(journal))
    if planned is None:
        return status, reason
    whole = {info.index for info in map(described_step, finished_steps(folder)) if info.whole}
    missing = [str(number) for number in range(1, planned + 1) if number not in whole]
    if not missing:
        return "complete", ""
    if status == "complete":
        return "aborted", f"of the planned steps {listed(missing)} cannot be read"
    return status, reason
