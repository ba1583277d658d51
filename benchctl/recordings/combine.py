"""Gathers the files of a campaign's steps in one recording, and takes a recording apart again."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import h5py

from benchctl.atomic import require_room, whole_file
from benchctl.recordings.digests import problems_of_recording, seal_recording
from benchctl.recordings.hdf5_files import RecordingFile, open_ours
from benchctl.recordings.model import Meta
from benchctl.recordings.schema import FINISHED_SUFFIX, STEPS, attach_axes, group_name
from benchctl.recordings.step_writer import file_stem
from benchctl.recordings.writer import new_file
from instruments.errors import UsageError


def combine(files: Sequence[Path], path: Path, meta: Meta) -> None:
    """Write one recording with the steps of several sealed files, in the order given.

    Compressed chunks are copied as they are. Before the file gets its name every sample in it is read back and held
    against the digest it had in its step's file. Raises `UsageError` where one does not agree or the disk refuses;
    nothing is left behind.
    """
    require_room(path, sum(file.stat().st_size for file in files))
    with whole_file(path) as temporary:
        with new_file(temporary, meta) as target:
            for file in files:
                with open_ours(file) as source:
                    for name in source[STEPS]:
                        source[STEPS].copy(name, target[STEPS])
                        _renew_references(target[STEPS][name])
            seal_recording(target)
        with h5py.File(temporary, "r") as written:
            for problem in problems_of_recording(written):
                raise UsageError(
                    f"{path}: not written: {problem}; the steps are still in {path.parent / STEPS}, "
                    "benchctl recover tries it again"
                )


def take_apart(recording: Path, folder: Path, meta: Meta) -> None:
    """Write each step of a recording to a file of its own, as a campaign's `steps/` has them; the reverse of `combine`.

    `folder` is where those files go; it exists. Every sample is read back and held against its digest. Raises
    `UsageError` where one does not agree or the disk refuses; the recording is left as it is.
    """
    require_room(folder, recording.stat().st_size)
    with closing(RecordingFile(recording)) as described:
        infos = described.infos
    with open_ours(recording) as source:
        for problem in problems_of_recording(source):
            raise UsageError(
                f"{recording}: changed since it was written, and so not gone on with: {problem}; "
                "take it from where it was copied"
            )
        for info in infos:
            name = group_name(info.index)
            with whole_file(folder / f"{file_stem(info)}{FINISHED_SUFFIX}") as temporary:
                with new_file(temporary, meta) as target:
                    source.copy(name, target, name)
                    _renew_references(target[name])
                    seal_recording(target)
                with h5py.File(temporary, "r") as written:
                    for problem in problems_of_recording(written):
                        raise UsageError(
                            f"{recording}: cannot be taken apart: {problem}; take it from where it was copied"
                        )


def _renew_references(step: h5py.Group) -> None:
    """Point the channels at their axes again: copied by HDF5 into another file, references point nowhere."""
    for dataset in step.values():
        for name in ("DIMENSION_LIST", "REFERENCE_LIST"):
            if name in dataset.attrs:
                del dataset.attrs[name]
    attach_axes(step)
