"""Opens a campaign's folder for going on: as it was when its next step was to begin."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

from benchctl.atomic import disk_errors, sync_folder, whole_file
from benchctl.locks import Lock
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.campaign_manifest import MANIFEST
from benchctl.recordings.campaign_state import described
from benchctl.recordings.combine import take_apart
from benchctl.recordings.gather import finished_steps
from benchctl.recordings.hdf5_files import RecordingFile
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.reader import campaign_files
from benchctl.recordings.schema import CAMPAIGN, JOURNAL, PART_SUFFIX, RECORDING, STEPS
from benchctl.recordings.torn import (
    damage,
    described_step,
    gathered_files,
    put_in_order,
    put_recording_aside,
    read_step,
    remove_leftovers,
    write_step_file,
)
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError


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
    """Go on with a campaign of `planned` steps, finished or torn, whose lock the caller has; its steps beside.

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
