"""Write a finished recording at once: an import, a simulation, an export.

Samples are packed as HDF5's own filters do (shuffle, deflate), on all cores, and digested meanwhile. HDF5 compresses
one chunk after the other in one thread; chunks that are shuffled and deflated here and written unchanged make the same
kind of file, which any HDF5 reads.

Deflate does not prescribe the search for repetitions. Byte planes of noise repeat in runs or not at all: for these,
zlib's Z_RLE is twice as fast and packs better. Byte planes of a steady count repeat at a distance, which only the full
search finds. The full search is tried on the first chunk of each block, and Z_RLE, too, if the full search does not
find much; the better one is used for the rest of the block.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import numpy.typing as npt

from benchctl.atomic import whole_file
from benchctl.recordings.digests import SampleDigest, Written, blocks, problems_of_recording, seal_recording, seal_step
from benchctl.recordings.hdf5_guard import note_own
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.opening import create_hdf5, give_back, reserve
from benchctl.recordings.schema import (
    CHUNK,
    DEFLATE_LEVEL,
    STEPS,
    channel_attributes,
    check_channels,
    create_channels,
    group_name,
    info_attributes,
    meta_attributes,
    write_attributes,
)
from benchctl.side_by_side import cores, in_order
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

_BLOCK = 32 * CHUNK
"""Samples of one task, 4 MiB; as many tasks as cores, and a few more, are in memory at once."""
_SHORT = 4 * CHUNK
_RUNS, _ALL = zlib.Z_RLE, zlib.Z_DEFAULT_STRATEGY
_REPEATS = 12
"""A full search that packs by this factor has found repetitions at a distance; Z_RLE would take more time and space."""


@dataclass(frozen=True, slots=True)
class _Piece:
    """Samples that go into a dataset from `start` on, in chunks of `chunk` samples."""

    dataset: h5py.Dataset
    start: int
    chunk: int
    samples: FloatArray


def write_samples(
    datasets: Mapping[str, h5py.Dataset], channels: Mapping[str, FloatArray | h5py.Dataset]
) -> dict[str, str]:
    """Fill datasets that `create_channels` made, from arrays or from datasets of another file, block by block.

    Returns the digest of each channel's samples. Raises `OSError` if the disk refuses.
    """
    digests = {name: SampleDigest(len(dataset)) for name, dataset in datasets.items()}
    is_short = all(len(dataset) <= _SHORT for dataset in datasets.values())  # starting a thread would take as long
    for piece, chunks in in_order(_packed, _pieces(datasets, channels, digests), 1 if is_short else cores()):
        for number, chunk in enumerate(chunks):
            piece.dataset.id.write_direct_chunk((piece.start + number * piece.chunk,), chunk)
    return {name: digest.hexdigest() for name, digest in digests.items()}


def _pieces(
    datasets: Mapping[str, h5py.Dataset],
    channels: Mapping[str, FloatArray | h5py.Dataset],
    digests: Mapping[str, SampleDigest],
) -> Iterator[_Piece]:
    """Yield all samples in order, and digest them."""
    for name, dataset in datasets.items():
        for part in blocks(len(dataset), _BLOCK):
            samples = np.ascontiguousarray(channels[name][part], dtype="<f8")
            digests[name].update(samples)
            yield _Piece(dataset, part.start, dataset.chunks[0], samples)


def _packed(piece: _Piece) -> tuple[_Piece, list[bytes]]:
    return piece, packed(piece.samples, piece.chunk)


def packed(samples: FloatArray, chunk: int) -> list[bytes]:
    """Return the chunks of samples, shape (n,), shuffled and deflated; the last one is padded with zeros."""
    planes = _shuffled(samples, chunk)
    first = next(planes)
    best, there = _ALL, _deflated(first, _ALL)
    if len(there) * _REPEATS > first.nbytes and len(runs := _deflated(first, _RUNS)) < len(there):
        best, there = _RUNS, runs
    return [there, *(_deflated(each, best) for each in planes)]


def _shuffled(samples: FloatArray, chunk: int) -> Iterator[npt.NDArray[np.uint8]]:
    """Yield the bytes of each chunk, the first bytes of all samples, then the second ones, …: shape (8, chunk)."""
    for start in range(0, len(samples), chunk):
        piece = samples[start : start + chunk]
        planes = np.zeros((8, chunk), dtype=np.uint8)
        planes[:, : len(piece)] = piece.view(np.uint8).reshape(-1, 8).T
        yield planes


def _deflated(planes: npt.NDArray[np.uint8], strategy: int) -> bytes:
    compressor = zlib.compressobj(DEFLATE_LEVEL, strategy=strategy)
    return compressor.compress(planes.data) + compressor.flush()


def write_recording(path: Path, meta: Meta, steps: Iterable[Step]) -> None:
    """Write a finished recording as one file; steps are taken one at a time and may be created meanwhile.

    Parameters
    ----------
    path
        The file to write; replaced if it exists. While it is written it has another name, so that no partial file is
        ever found.
    meta
        Everything that is not a sample. `extra["channel_units"]` contains the units of channels that the model does not
        know.
    steps
        Each with float64 channels of shape (n,) and their time axis. `info.samples` and `info.digest` are filled in
        here.

    Raises
    ------
    UsageError
        Two steps with one index, channels that do not fit together, a disk that refuses. No partial file remains.
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
    """Read a sealed file back; raises `UsageError` if one of its digests does not agree."""
    with h5py.File(path, "r") as written:
        for problem in problems_of_recording(written):
            raise UsageError(f"{path}: was not written as it should be: {problem}; check the disk")


def new_file(path: Path, meta: Meta, *, growing: bool = False) -> h5py.File:
    """Create a file with the root's attributes and no steps yet, open for writing; `growing` as in `create_hdf5`."""
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
    """Create a file as `new_file` does, finish it in the block, and release the reserved space not needed."""
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
