"""Gathers the files of a campaign's steps in one recording, and takes a recording apart again.

A recording may be begun while its campaign still runs, a step at a time: see `gathering`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import h5py

from benchctl.atomic import whole_file
from benchctl.recordings.digests import Problem, problems_of_member, problems_of_recording, seal_recording
from benchctl.recordings.hdf5_files import RecordingFile, open_ours
from benchctl.recordings.model import Meta
from benchctl.recordings.opening import FINISHED_LIBVER, create_hdf5, give_back, reserve
from benchctl.recordings.schema import (
    FINISHED_SUFFIX,
    STEPS,
    attach_axes,
    group_name,
    meta_attributes,
    write_attributes,
)
from benchctl.recordings.step_writer import file_stem
from benchctl.recordings.writer import finished_file, require_intact
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True)
class Begun:
    """A recording without attributes and seal, and the names of the files whose steps `add` put into it, in order."""

    path: Path
    files: tuple[str, ...]


def begin(path: Path) -> None:
    """Make a recording without attributes, seal and steps, for `add`."""
    with create_hdf5(path) as target:
        target.create_group(STEPS, track_order=True)


def add(path: Path, files: Sequence[Path]) -> None:
    """Add the steps of sealed files to what was begun; see `combine` for what is checked and raised."""
    with h5py.File(path, "r+", libver=FINISHED_LIBVER) as target:
        names = [name for file in files for name in _copied(file, target)]
    with h5py.File(path, "r") as written:
        for name in names:
            _refuse(path, problems_of_member(written, name))


def combine(files: Sequence[Path], path: Path, meta: Meta, begun: Begun | None = None) -> None:
    """Write one recording with the steps of several sealed files, in the order given.

    Compressed chunks are copied as they are. Before the file gets its name every sample in it is read back and held
    against the digest it had in its step's file; of the steps that were `begun`, the first of those, `add` has done so.
    Raises `UsageError` where one does not agree or the disk refuses; nothing is left behind.
    """
    rest = files[len(begun.files) :] if begun else files
    with whole_file(path) as temporary:
        if begun is None:
            begin(temporary)
        else:
            begun.path.replace(temporary)
        with h5py.File(temporary, "r+", libver=FINISHED_LIBVER) as target:
            write_attributes(target, meta_attributes(meta))
            proven = tuple(target[STEPS])
            if len(proven) != len(files) - len(rest):
                raise UsageError(
                    f"{path}: not written: {len(proven)} steps were gathered, expected {len(files) - len(rest)}"
                )
            for file in rest:
                _copied(file, target)
            seal_recording(target)
        give_back(temporary)
        with h5py.File(temporary, "r") as written:
            _refuse(path, problems_of_recording(written, proven=proven))


def _copied(file: Path, target: h5py.File) -> list[str]:
    """Copy the step of a file, in fact all that it has; returns the names of their groups."""
    with open_ours(file) as source:
        names = list(source[STEPS])
        for name in names:
            _copy(source, f"{STEPS}/{name}", target)
    return names


def _copy(source: h5py.File, step: str, target: h5py.File) -> None:
    """Copy a step's group, compressed chunks as they are."""
    reserve(target, sum(dataset.id.get_storage_size() for dataset in source[step].values()))
    source.copy(step, target, step)
    _renew_references(target[step])


def _refuse(path: Path, problems: Iterable[Problem]) -> None:
    for problem in problems:
        raise UsageError(
            f"{path}: not written: {problem}; the steps are still in {path.parent / STEPS}, "
            "benchctl recover tries it again"
        )


def take_apart(recording: Path, folder: Path, meta: Meta) -> None:
    """Write each step of a recording to a file of its own, as a campaign's `steps/` has them; the reverse of `combine`.

    `folder` is where those files go; it exists. Every sample is read back and compared with its digest. Raises
    `UsageError` where one does not agree or the disk refuses; the recording, whose digests the caller has checked, is
    left as it is.
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
    """Point the channels at their axes again: copied by HDF5 into another file, references point nowhere."""
    for dataset in step.values():
        for name in ("DIMENSION_LIST", "REFERENCE_LIST"):
            if name in dataset.attrs:
                del dataset.attrs[name]
    attach_axes(step)
