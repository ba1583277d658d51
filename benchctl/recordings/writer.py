"""Writes a finished recording in one go: an import, a simulation, an export."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import h5py

from benchctl.atomic import whole_file
from benchctl.recordings.digests import Written, problems_of_recording, seal_recording, seal_step
from benchctl.recordings.hdf5_trial import note_own
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.opening import create_hdf5, give_back, reserve
from benchctl.recordings.packing import write_samples
from benchctl.recordings.schema import (
    STEPS,
    channel_attributes,
    check_channels,
    create_channels,
    group_name,
    info_attributes,
    meta_attributes,
    write_attributes,
)
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError


def write_recording(path: Path, meta: Meta, steps: Iterable[Step]) -> None:
    """Write a finished recording as one file; steps are taken one at a time and may be made meanwhile.

    Parameters
    ----------
    path
        The file to be; replaced where it exists. While it is written it has another name, so that no half of it is
        ever found.
    meta
        Everything that is not a sample. `extra["channel_units"]` names the units of channels that the model does not
        know.
    steps
        Each with float64 channels of shape (n,) and their time axis. `info.samples` and `info.digest` are filled in
        here.

    Raises
    ------
    UsageError
        Two steps with one index, channels that do not fit together, a disk that refuses. Nothing is left behind.
    """
    with whole_file(path) as temporary, finished_file(temporary, meta) as file:
        for step in steps:
            check_channels(f"step {step.info.index} {step.info.name!r}", step.channels)
            if group_name(step.info.index) in file:
                raise UsageError(f"{path}: two steps have the index {step.info.index}; every step needs its own")
            write_step(file, step.info, step.channels, meta)
        seal_recording(file)
    note_own(path)


def require_intact(path: Path) -> None:
    """Read a sealed file back; raises `UsageError` where one of its digests does not hold."""
    with h5py.File(path, "r") as written:
        for problem in problems_of_recording(written):
            raise UsageError(f"{path}: was not written as it should be: {problem}; check the disk")


def new_file(path: Path, meta: Meta, *, growing: bool = False) -> h5py.File:
    """A file with the root's attributes and no steps yet, open for writing; `growing` as `create_hdf5` has it."""
    file = create_hdf5(path, growing=growing)
    try:
        write_attributes(file, meta_attributes(meta))
        file.create_group(STEPS, track_order=True)
    except BaseException:
        file.close()
        raise
    return file


@contextmanager
def finished_file(path: Path, meta: Meta) -> Iterator[h5py.File]:
    """As `new_file`, for a file that is finished in the block and takes no more of the disk than it needs."""
    with new_file(path, meta) as file:
        yield file
    give_back(path)


def write_step(
    file: h5py.File, info: StepInfo, channels: Mapping[str, FloatArray | h5py.Dataset], meta: Meta
) -> StepInfo:
    """Write a step, compressed and sealed, from arrays or from datasets of another file, block by block.

    Returns its description with `samples` and `digest` as they were written.
    """
    lengths = {name: len(samples) for name, samples in channels.items()}
    reserve(file, 8 * sum(lengths.values()))
    info = replace(info, samples=len(channels["time_s"]) if "time_s" in channels else 0)
    group = file.create_group(group_name(info.index), track_order=True)
    written = Written(info_attributes(info), {name: channel_attributes(name, meta) for name in lengths})
    write_attributes(group, written.step)
    datasets = create_channels(group, lengths, meta)
    digests = write_samples(datasets, channels)
    return replace(info, digest=seal_step(group, datasets, digests, written))
