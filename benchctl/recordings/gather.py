"""Gather the files of a campaign's steps in one file for keeping, and split such a file into step files again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

import h5py

from benchctl.atomic import disk_errors, sync_folder, whole_file
from benchctl.recordings.digests import problems_of_recording, seal_recording
from benchctl.recordings.hdf5_files import RecordingFile, open_ours
from benchctl.recordings.journal import journal_text, sync_journal
from benchctl.recordings.model import Meta, Status
from benchctl.recordings.opening import create_hdf5, give_back, reserve
from benchctl.recordings.schema import (
    CAMPAIGN,
    FINISHED_SUFFIX,
    JOURNAL,
    RECORDING,
    STEPS,
    attach_axes,
    group_name,
    meta_attributes,
    write_attributes,
)
from benchctl.recordings.step_writer import file_stem
from benchctl.recordings.writer import finished_file, require_intact
from benchctl_instruments.errors import UsageError


def combine(files: Sequence[Path], path: Path, meta: Meta) -> None:
    """Write one recording with the steps of several sealed files, in the order given.

    Compressed chunks are copied unchanged. Before the file gets its name, every sample in it is read back and compared
    with its digest in the step's file. Raises `UsageError` if one does not agree or the disk refuses; no partial file
    remains.
    """
    with whole_file(path) as temporary:
        with create_hdf5(temporary) as target:
            target.create_group(STEPS, track_order=True)
            write_attributes(target, meta_attributes(meta))
            for file in files:
                with open_ours(file) as source:
                    for name in source[STEPS]:
                        _copy(source, f"{STEPS}/{name}", target)
            seal_recording(target)
        give_back(temporary)
        with h5py.File(temporary, "r") as written:
            for problem in problems_of_recording(written):
                raise UsageError(
                    f"{path}: not written: {problem}; the steps are still in {path.parent / STEPS}, "
                    "benchctl recover tries it again"
                )


def _copy(source: h5py.File, step: str, target: h5py.File) -> None:
    """Copy a step's group, with compressed chunks unchanged."""
    reserve(target, sum(dataset.id.get_storage_size() for dataset in source[step].values()))
    source.copy(step, target, step)
    _renew_references(target[step])


def take_apart(recording: Path, folder: Path, meta: Meta) -> None:
    """Write each step of a recording to a separate file, as in a campaign's `steps/`; the reverse of `combine`.

    `folder` is the existing folder for these files. Every sample is read back and compared with its digest. Raises
    `UsageError` if one does not agree or the disk refuses; the recording, whose digests the caller has checked, is not
    changed.
    """
    with closing(RecordingFile(recording)) as described:
        infos = described.infos
    with open_ours(recording) as source:
        for info in infos:
            name = group_name(info.index)
            with whole_file(folder / f"{file_stem(info)}{FINISHED_SUFFIX}") as temporary:
                with finished_file(temporary, meta) as target:
                    _copy(source, name, target)
                    seal_recording(target)
                require_intact(temporary)


def _renew_references(step: h5py.Group) -> None:
    """Attach the channels to their axes again: the references are invalid after HDF5 has copied them."""
    for dataset in step.values():
        for name in ("DIMENSION_LIST", "REFERENCE_LIST"):
            if name in dataset.attrs:
                del dataset.attrs[name]
    attach_axes(step)


def finished_steps(folder: Path) -> list[Path]:
    """Return the files of a campaign's finished steps, in the order of their indices."""
    return sorted((folder / STEPS).glob(f"[0-9]*{FINISHED_SUFFIX}"))


def gather(folder: Path, meta: Meta, status: Status, reason: str) -> Path:
    """Gather all finished steps in `recording.h5`, check every digest in it, remove their files; return its path.

    `reason` and the journal are stored as `Meta.provenance["reason"]` and `["journal"]`. Raises `UsageError` if this
    fails; the steps then remain unchanged.
    """
    sync_journal(folder / JOURNAL)
    provenance = {**meta.provenance, "reason": reason, "journal": journal_text(folder / JOURNAL)}
    recording, files = folder / RECORDING, finished_steps(folder)
    combine(files, recording, replace(meta, status=status, provenance=provenance))
    remove_gathered(folder, files)
    return recording


def remove_gathered(folder: Path, files: Iterable[Path]) -> None:
    """Remove the files of steps that `recording.h5`, with all digests checked, contains, and `campaign.h5`."""
    with disk_errors(folder):
        for file in files:
            file.unlink()
        with suppress(OSError):  # it is not empty, or does not exist
            (folder / STEPS).rmdir()
        (folder / CAMPAIGN).unlink(missing_ok=True)
        sync_folder(folder)
