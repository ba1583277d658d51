"""Opens a campaign's folder for going on: as it was when its next step was to begin."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
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
from benchctl.recordings.schema import CAMPAIGN, JOURNAL, RECORDING, STEPS
from benchctl.recordings.torn import described_step, put_in_order, read_step, remove_leftovers, write_step_file
from benchctl.recordings.writer import write_recording


def reopen(folder: Path, planned: int, lock: Lock) -> tuple[CampaignWriter, list[StepInfo]]:
    """Go on with a campaign of `planned` steps, finished or torn, whose lock the caller has; its steps beside.

    A recording is taken apart into files of steps again and removed last, so that a crash meanwhile loses nothing.
    Planned steps that were cut get an index behind the plan's last and the role `none`: their own is free again.
    """
    meta = described(folder)
    with disk_errors(folder):
        (folder / MANIFEST).unlink(missing_ok=True)  # who closes the campaign again writes it anew
    if (folder / RECORDING).exists():
        _take_apart(folder, meta)
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


def _take_apart(folder: Path, meta: Meta) -> None:
    recording = folder / RECORDING
    with disk_errors(folder):
        if (folder / STEPS).exists():
            shutil.rmtree(folder / STEPS)  # of an attempt that died: the recording has it all
        (folder / STEPS).mkdir()
    if not (folder / JOURNAL).exists():
        _restore_journal(recording, folder / JOURNAL)
    take_apart(recording, folder / STEPS, meta)
    write_recording(folder / CAMPAIGN, meta, ())
    with disk_errors(folder):
        sync_folder(folder)
        recording.unlink()
        sync_folder(folder)


def _restore_journal(recording: Path, journal: Path) -> None:
    file = RecordingFile(recording)
    file.close()
    with whole_file(journal) as temporary:
        temporary.write_text(file.meta.provenance.get("journal", ""), encoding="utf-8", newline="\n")


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
