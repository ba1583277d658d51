"""Repair a campaign's folder after a crash; close its recording, or reopen it for resuming.

Nothing that holds data is removed before every digest of its replacement was checked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchctl.atomic import disk_errors, sync_folder, whole_file
from benchctl.limits import listed
from benchctl.locks import Lock
from benchctl.recordings.campaign_folder import CampaignWriter, campaign_lock
from benchctl.recordings.campaign_manifest import MANIFEST, write_manifest
from benchctl.recordings.digests import problems_of_recording
from benchctl.recordings.gather import finished_steps, gather, remove_gathered, take_apart
from benchctl.recordings.hdf5_files import RecordingFile, open_ours
from benchctl.recordings.hdf5_guard import note_ended
from benchctl.recordings.journal import (
    append_event,
    events_in,
    journal_text,
    last_word,
    mend_journal,
    planned_steps,
)
from benchctl.recordings.model import Meta, Status, Step, StepInfo
from benchctl.recordings.reader import campaign_files, described, require_campaign
from benchctl.recordings.runs import gaps
from benchctl.recordings.schema import (
    CAMPAIGN,
    FINISHED_SUFFIX,
    JOURNAL,
    LOCK,
    PART_SUFFIX,
    RECORDING,
    STEPS,
    UNREADABLE,
)
from benchctl.recordings.step_writer import file_stem
from benchctl.recordings.writer import require_intact, write_recording
from benchctl_instruments.errors import UsageError

_SUPERBLOCK_BYTES = 48
_FLAGS_AT = 11
_WRITING, _WRITING_SWMR = 1, 4
"""Bits of a superblock's consistency flags (HDF5 file format, III.A.2): open for writing, and open under SWMR."""

_ROUNDING = 1e-6
"""Relative change of a rate by the rounding of stamps, with a margin."""


def put_in_order(folder: Path, meta: Meta) -> None:
    """Repair the journal, close the step that was being written as a cut one, move unreadable files aside.

    Afterwards every file in `steps/` is a finished step with valid digests. The caller has the campaign's lock.
    """
    (folder / STEPS).mkdir(exist_ok=True)
    mend_journal(folder / JOURNAL)
    for finished in finished_steps(folder):
        if why := damage(finished):
            _put_aside(folder, finished, why)
    for part in sorted((folder / STEPS).glob(f"[0-9]*{PART_SUFFIX}")):
        _close_part(folder, part, meta)


def gathered_files(folder: Path) -> list[Path] | None:
    """Return the files in `steps/` that an intact `recording.h5` has replaced; None if the steps are still needed.

    They are needed if there is no recording, or a damaged one. Raises `UsageError` if the recording is damaged and
    there is no step, or if it is intact and lacks an existing step.
    """
    recording, files = folder / RECORDING, sorted((folder / STEPS).glob(f"[0-9]*{FINISHED_SUFFIX}*"))
    if not recording.exists():
        return None
    if why := damage(recording):
        if any(not damage(file) for file in finished_steps(folder)):
            return None
        raise UsageError(
            f"{recording}: is damaged, and there are no steps to gather again; take it from where it was copied: "
            f"{why.removeprefix(f'{recording}: ')}"
        )
    with closing(RecordingFile(recording)) as opened:
        held = {info.index: info.digest for info in opened.infos}
    for file in files:
        if not _is_held(file, held):
            raise UsageError(f"{file}: is not in {recording}, which is sound; move one of them elsewhere")
    return files


def _is_held(file: Path, held: Mapping[int, str]) -> bool:
    """Whether a recording, given by its steps' digests by index, contains everything in a step's file."""
    if not file.name.endswith(PART_SUFFIX) and not damage(file):
        return described_step(file).digest in held.values()
    return int(file.name.partition("_")[0]) in held or _had_only_begun(file)


def remove_leftovers(folder: Path) -> None:
    """Remove partial files that a crash has left and whose sources still exist."""
    with disk_errors(folder):
        for leftover in [*folder.glob(".*.tmp"), *(folder / STEPS).glob(".*.tmp")]:
            leftover.unlink(missing_ok=True)


def described_step(path: Path) -> StepInfo:
    """Return the description in the file of a finished step."""
    with closing(RecordingFile(path)) as file:
        if len(file.infos) != 1:
            raise UsageError(f"{path}: expected one step, found {len(file.infos)}")
        return file.infos[0]


def read_step(path: Path) -> Step:
    """Read the one step of a step's file; from a `.part` the samples that all channels of an axis have."""
    with closing(RecordingFile(path)) as file:
        if len(file.infos) != 1:
            raise UsageError(f"{path}: expected one step, found {len(file.infos)}")
        return file.load(file.infos[0])


def write_step_file(folder: Path, step: Step, meta: Meta) -> Path:
    """Write a finished step to a campaign's `steps/`; return its file, synced to the disk, with its digests checked."""
    path = folder / STEPS / f"{file_stem(step.info)}{FINISHED_SUFFIX}"
    write_recording(path, meta, [step])
    require_intact(path)
    return path


def _close_part(folder: Path, part: Path, meta: Meta) -> None:
    finished = part.with_name(f"{part.name.removesuffix(PART_SUFFIX)}{FINISHED_SUFFIX}")
    if not finished.exists() and not _had_only_begun(part):
        try:
            step = read_step(part)
        except UsageError as err:
            _put_aside(folder, part, str(err))
            return
        rate_hz, gaps = _rate_and_gaps(step)
        info = replace(step.info, whole=False, sample_rate_hz=rate_hz, gaps=gaps, frames_lost=_frames_lost(step))
        write_step_file(folder, Step(info, step.channels), meta)
        append_event(folder / JOURNAL, "cut", {"index": info.index, "name": info.name, "samples": info.samples})
    with disk_errors(part):
        part.unlink()


def _had_only_begun(part: Path) -> bool:
    """Whether the program died while it created the file: samples are written only under SWMR, which starts later."""
    with part.open("rb") as file:
        superblock = file.read(_SUPERBLOCK_BYTES)
    if len(superblock) < _SUPERBLOCK_BYTES:
        return True
    return superblock[_FLAGS_AT] & (_WRITING | _WRITING_SWMR) == _WRITING


def _rate_and_gaps(step: Step) -> tuple[float | None, int]:
    """Return the scan rate and the number of gaps, from the stamps: both would have been written at the step's end."""
    asked_hz = step.info.sample_rate_hz
    if not asked_hz or "time_s" not in step.channels:
        return asked_hz, 0
    intervals_s = np.diff(step["time_s"])
    missing = gaps(intervals_s, 1.0 / asked_hz)
    usual_s = intervals_s[~missing]
    rate_hz = usual_s.size / float(usual_s.sum() or np.inf)
    differs = rate_hz > 0.0 and not math.isclose(rate_hz, asked_hz, rel_tol=_ROUNDING)
    return rate_hz if differs else asked_hz, int(np.count_nonzero(missing))


def _frames_lost(step: Step) -> int | None:
    """Return the number of missing frames between the recorded frames of a digital gyro; None if there is no gyro."""
    rate_hz = step.info.frame_rate_hz
    if not rate_hz or "frame_time_s" not in step.channels:
        return None
    return int(np.sum(np.rint(np.diff(step["frame_time_s"]) * rate_hz) - 1.0))


def damage(sealed: Path) -> str:
    """Return why a finished step, or a recording, cannot be used, with all its digests checked; empty if it can."""
    try:
        with open_ours(sealed) as file:
            return "; ".join(str(problem) for problem in problems_of_recording(file))
    except UsageError as err:
        return str(err)


def put_recording_aside(folder: Path) -> None:
    """Move `recording.h5`, if it exists, to the unreadable files: the steps are gathered again."""
    mend_journal(folder / JOURNAL)
    if (folder / RECORDING).exists():
        _put_aside(folder, folder / RECORDING, damage(folder / RECORDING))


def _put_aside(folder: Path, file: Path, why: str) -> None:
    with disk_errors(folder):
        (folder / UNREADABLE).mkdir(exist_ok=True)
        place = folder / UNREADABLE / file.name
        number = 1
        while place.exists():
            number += 1
            place = place.with_name(f"{file.name}.{number}")
        file.rename(place)
        sync_folder(folder / UNREADABLE)
    append_event(folder / JOURNAL, "unreadable", {"file": f"{UNREADABLE}/{place.name}", "why": why})


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovered:
    """A campaign whose recording is closed; `was_closed`: it already was. `unreadable` files were moved aside."""

    recording: Path
    status: Status
    reason: str
    steps: tuple[StepInfo, ...]
    unreadable: tuple[Path, ...]
    was_closed: bool

    @property
    def complete(self) -> int:
        """The number of complete steps."""
        return sum(info.whole for info in self.steps)


def recover(folder: Path) -> Recovered:
    """Gather the steps of a campaign whose program died into `recording.h5`, and write the folder's manifest.

    Does nothing if this was already done. The step that was being written becomes a cut one. If `recording.h5` is
    damaged and there are steps, they are gathered again. Nothing is removed before every digest of its replacement was
    checked, so this may itself be interrupted and called again. Raises `UsageError` if the campaign is being written,
    the folder contains none, there is only a damaged recording, or the disk refuses.
    """
    require_campaign(folder)
    was_closed = (folder / RECORDING).exists()
    begun = (folder / STEPS).exists() or (folder / CAMPAIGN).exists()
    unfinished = begun or not was_closed or not (folder / MANIFEST).exists()
    if unfinished or (folder / LOCK).exists():  # a crash in the last action leaves the lock's files
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
    """Finish the campaign; return whether its recording already existed."""
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
    """Return status and reason as recorded by the program, but complete if and only if all planned steps are."""
    status, reason = last_word(events_in(journal))
    planned = planned_steps(events_in(journal))
    if planned is None:
        return status, reason
    complete = {info.index for info in map(described_step, finished_steps(folder)) if info.whole}
    missing = [str(number) for number in range(1, planned + 1) if number not in complete]
    if not missing:
        return "complete", ""
    if status == "complete":
        return "aborted", f"of the planned steps {listed(missing)} cannot be read"
    return status, reason


def sound_steps(folder: Path) -> tuple[StepInfo, ...]:
    """Return the steps that `reopen` finds in a campaign: those with valid digests, and the readable part of a cut one.

    Nothing is changed. Raises `UsageError` if there is only a damaged `recording.h5`.
    """
    if gathered_files(folder) is not None:
        with closing(RecordingFile(folder / RECORDING)) as recording:
            return recording.infos
    infos = []
    for file in campaign_files(folder):
        with suppress(UsageError):  # `reopen` moves it aside
            if file.name.endswith(PART_SUFFIX) or not damage(file):
                infos.append(described_step(file))
    return tuple(infos)


def reopen(folder: Path, planned: int, lock: Lock) -> tuple[CampaignWriter, list[StepInfo]]:
    """Reopen a campaign of `planned` steps, finished or interrupted, whose lock the caller has; also return its steps.

    A recording is split into files of steps again and removed last, so that a crash meanwhile loses nothing. Planned
    steps that were cut get an index after the plan's last one and the role `none`, so that their own index is free
    again.
    """
    gathered = gathered_files(folder)  # before anything is changed
    with disk_errors(folder):
        (folder / MANIFEST).unlink(missing_ok=True)  # it is written again when the campaign is closed again
    if gathered is not None:
        _take_apart(folder, gathered)
    else:
        put_recording_aside(folder)
    meta = described(folder)
    write_recording(folder / CAMPAIGN, meta, ())
    remove_leftovers(folder)
    put_in_order(folder, meta)
    infos = []
    for file in finished_steps(folder):
        info = described_step(file)
        if info.whole or info.index > planned:
            infos.append(info)
    for file in finished_steps(folder):
        info = described_step(file)
        if not info.whole and info.index <= planned:
            _set_aside(folder, file, planned, infos, meta)
    return CampaignWriter(folder, meta, lock), sorted(infos, key=lambda info: info.index)


def _take_apart(folder: Path, gathered: Sequence[Path]) -> None:
    recording = folder / RECORDING
    meta = described(folder)
    with disk_errors(folder):
        for file in gathered:
            file.unlink()  # from an interrupted attempt: the recording contains everything
        (folder / STEPS).mkdir(exist_ok=True)
    if not (folder / JOURNAL).exists():
        _restore_journal(recording, folder / JOURNAL)
    take_apart(recording, folder / STEPS, meta)
    write_recording(folder / CAMPAIGN, meta, ())
    with disk_errors(folder):
        sync_folder(folder)
        recording.unlink()
        sync_folder(folder)


def _restore_journal(recording: Path, journal: Path) -> None:
    with closing(RecordingFile(recording)) as file:
        text = file.meta.provenance.get("journal", "")
    with whole_file(journal) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def _set_aside(folder: Path, file: Path, planned: int, infos: list[StepInfo], meta: Meta) -> None:
    """Move a cut step to an index after the plan's last one, and append it to `infos`."""
    step = read_step(file)
    there = any(info.t_start == step.info.t_start and info.index > planned for info in infos)
    if not there and any(samples.size for samples in step.channels.values()):
        moved = replace(
            step.info,
            index=free_index(infos, planned),
            name=f"cut attempt of step {step.info.index}: {step.info.name}",
            role="none",
        )
        write_step_file(folder, Step(moved, step.channels), meta)
        infos.append(moved)
    with disk_errors(file):
        file.unlink()


def free_index(infos: Sequence[StepInfo], planned: int) -> int:
    """Return the first index after the plan's last one that no step has."""
    return max((planned, *(info.index for info in infos))) + 1
