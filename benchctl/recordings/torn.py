"""What a crash left in a campaign's folder, put in order: nothing is removed before its successor is on the disk."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchctl.atomic import disk_errors, sync_folder
from benchctl.recordings.digests import problems_of_recording
from benchctl.recordings.gather import finished_steps
from benchctl.recordings.hdf5_files import RecordingFile, open_ours
from benchctl.recordings.journal import append_event, mend_journal
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.schema import FINISHED_SUFFIX, JOURNAL, PART_SUFFIX, STEPS, UNREADABLE
from benchctl.recordings.step_writer import file_stem
from benchctl.recordings.writer import write_recording
from instruments.errors import UsageError

_SUPERBLOCK_BYTES = 48
_FLAGS_AT = 11
_WRITING, _WRITING_SWMR = 1, 4
"""Bits of a superblock's consistency flags (HDF5 file format, III.A.2): open for writing, and that under SWMR."""

_GAP = 1.5
"""Sample intervals beyond which two scans have a gap between them."""


def put_in_order(folder: Path, meta: Meta) -> None:
    """Mend the journal, close the step that was being written as a cut one, put aside what cannot be read.

    Afterwards every file in `steps/` is a finished step whose digests hold. The caller has the campaign's lock.
    """
    (folder / STEPS).mkdir(exist_ok=True)
    mend_journal(folder / JOURNAL)
    for finished in finished_steps(folder):
        if damage := _damage(finished):
            _put_aside(folder, finished, damage)
    for part in sorted((folder / STEPS).glob(f"[0-9]*{PART_SUFFIX}")):
        _close_part(folder, part, meta)


def remove_leftovers(folder: Path) -> None:
    """Remove halves of files, which a death has left and whose sources are still there."""
    with disk_errors(folder):
        for leftover in [*folder.glob(".*.tmp"), *(folder / STEPS).glob(".*.tmp")]:
            leftover.unlink(missing_ok=True)


def described_step(path: Path) -> StepInfo:
    """What the file of a finished step says of it."""
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
    """Write a finished step to a campaign's `steps/`; returns its file, which is on the disk."""
    path = folder / STEPS / f"{file_stem(step.info)}{FINISHED_SUFFIX}"
    write_recording(path, meta, [step])
    return path


def _close_part(folder: Path, part: Path, meta: Meta) -> None:
    finished = part.with_name(f"{part.name.removesuffix(PART_SUFFIX)}{FINISHED_SUFFIX}")
    if not finished.exists() and not _had_only_begun(part):
        try:
            step = read_step(part)
        except UsageError as err:
            _put_aside(folder, part, str(err))
            return
        info = replace(step.info, whole=False, gaps=_gaps(step), frames_lost=_frames_lost(step))
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


def _gaps(step: Step) -> int:
    """How many gaps the scans have: their count was to be written when the step was closed."""
    rate_hz = step.info.sample_rate_hz
    if not rate_hz or "time_s" not in step.channels:
        return 0
    return int(np.count_nonzero(np.diff(step["time_s"]) * rate_hz > _GAP))


def _frames_lost(step: Step) -> int | None:
    """How many frames of a digital gyro are missing among those that are there; None where it has none."""
    rate_hz = step.info.frame_rate_hz
    if not rate_hz or "frame_time_s" not in step.channels:
        return None
    return int(np.sum(np.rint(np.diff(step["frame_time_s"]) * rate_hz) - 1.0))


def _damage(finished: Path) -> str:
    """Why a finished step cannot be used; empty where it can."""
    try:
        with open_ours(finished) as file:
            return "; ".join(str(problem) for problem in problems_of_recording(file))
    except UsageError as err:
        return str(err)


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
