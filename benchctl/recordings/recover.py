"""Put in order what a crash left in a campaign's folder; close its recording, or open it for going on.

Nothing that holds data is removed before every digest of what replaces it was checked.
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
"""Bits of a superblock's consistency flags (HDF5 file format, III.A.2): open for writing, and that under SWMR."""

_ROUNDING = 1e-6
"""Relative: what the rounding of stamps may change of a rate, with room."""


def put_in_order(folder: Path, meta: Meta) -> None:
    """Mend the journal, close the step that was being written as a cut one, put aside what cannot be read.

    Afterwards every file in `steps/` is a finished step whose digests hold. The caller has the campaign's lock.
    """
    (folder / STEPS).mkdir(exist_ok=True)
    mend_journal(folder / JOURNAL)
    for finished in finished_steps(folder):
        if why := damage(finished):
            _put_aside(folder, finished, why)
    for part in sorted((folder / STEPS).glob(f"[0-9]*{PART_SUFFIX}")):
        _close_part(folder, part, meta)


def gathered_files(folder: Path) -> list[Path] | None:
    """The files in `steps/` that `recording.h5`, all of whose digests hold, has replaced; None: the steps count.

    They count where there is no recording, or one that is damaged. Raises `UsageError` where that is damaged and there
    is no step, or is sound and lacks a step that is there.
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
    """Whether a recording, which has the digests of its steps by their index, holds all that a step's file has."""
    if not file.name.endswith(PART_SUFFIX) and not damage(file):
        return described_step(file).digest in held.values()
    return int(file.name.partition("_")[0]) in held or _had_only_begun(file)


def remove_leftovers(folder: Path) -> None:
    """Remove halves of files, which a death has left and whose sources are still there."""
    with disk_errors(folder):
        for leftover in [*folder.glob(".*.tmp"), *(folder / STEPS).glob(".*.tmp")]:
            leftover.unlink(missing_ok=True)


def described_step(path: Path) -> StepInfo:
    """The description in the file of a finished step."""
    with closing(RecordingFile(path)) as file:
        if len(file.infos) != 1:
            raise UsageError(f"{path}: expected one step, found {len(file.infos)}")
        return file.infos[0]


def read_step(path: Path) -> Step:
    """The one step of a step's file, in memory; of a `.part` those samples that all channels of an axis have."""
    with closing(RecordingFile(path)) as file:
        if len(file.infos) != 1:
            raise UsageError(f"{path}: expected one step, found {len(file.infos)}")
        return file.load(file.infos[0])


def write_step_file(folder: Path, step: Step, meta: Meta) -> Path:
    """Write a finished step to a campaign's `steps/`; returns its file, which is on the disk, its digests checked."""
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
    """Whether the program died while it made the file: samples are put in under SWMR only, which comes afterwards."""
    with part.open("rb") as file:
        superblock = file.read(_SUPERBLOCK_BYTES)
    if len(superblock) < _SUPERBLOCK_BYTES:
        return True
    return superblock[_FLAGS_AT] & (_WRITING | _WRITING_SWMR) == _WRITING


def _rate_and_gaps(step: Step) -> tuple[float | None, int]:
    """The scan rate and how many gaps the scans have, by their stamps: both were to be written at the step's end."""
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
    """How many frames of a digital gyro are missing among those that are there; None where it has none."""
    rate_hz = step.info.frame_rate_hz
    if not rate_hz or "frame_time_s" not in step.channels:
        return None
    return int(np.sum(np.rint(np.diff(step["frame_time_s"]) * rate_hz) - 1.0))


def damage(sealed: Path) -> str:
    """Why a finished step, or a recording, cannot be used, after all its digests were checked; empty where it can."""
    try:
        with open_ours(sealed) as file:
            return "; ".join(str(problem) for problem in problems_of_recording(file))
    except UsageError as err:
        return str(err)


def put_recording_aside(folder: Path) -> None:
    """Put `recording.h5`, where it is there, to the files that cannot be used: the steps are gathered again."""
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
    """A campaign whose recording is closed; `was_closed`: it was so before. `unreadable` files were put aside."""

    recording: Path
    status: Status
    reason: str
    steps: tuple[StepInfo, ...]
    unreadable: tuple[Path, ...]
    was_closed: bool

    @property
    def whole(self) -> int:
        """How many steps are complete."""
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
    """As the program noted, but complete if and only if every planned step is complete."""
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


def sound_steps(folder: Path) -> tuple[StepInfo, ...]:
    """The steps that `reopen` finds in a campaign: those whose digests hold, and what can be read of a cut one.

    Nothing is changed. Raises `UsageError` where a damaged `recording.h5` is all there is.
    """
    if gathered_files(folder) is not None:
        with closing(RecordingFile(folder / RECORDING)) as recording:
            return recording.infos
    infos = []
    for file in campaign_files(folder):
        with suppress(UsageError):  # `reopen` puts it aside
            if file.name.endswith(PART_SUFFIX) or not damage(file):
                infos.append(described_step(file))
    return tuple(infos)


def reopen(folder: Path, planned: int, lock: Lock) -> tuple[CampaignWriter, list[StepInfo]]:
    """Go on with a campaign of `planned` steps, finished or torn, whose lock the caller has; also returns its steps.

    A recording is taken apart into files of steps again and removed last, so that a crash meanwhile loses nothing.
    Planned steps that were cut get an index behind the plan's last and the role `none`: their own is free again.
    """
    gathered = gathered_files(folder)  # before anything is changed
    with disk_errors(folder):
        (folder / MANIFEST).unlink(missing_ok=True)  # who closes the campaign again writes it anew
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
            file.unlink()  # of an attempt that died: the recording has it all
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
    """Move a cut step behind the plan's last; `infos` takes it in."""
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
    """The first index behind the plan's last that no step has."""
    return max((planned, *(info.index for info in infos))) + 1
