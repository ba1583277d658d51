"""Writes samples as HDF5's own filters would (shuffle, deflate), on all cores, and digests them on the way.

HDF5 compresses one chunk after the other in one thread. Chunks that are shuffled and deflated here and handed over as
they are make the same kind of file, which any HDF5 reads.

Deflate leaves open how to search for what repeats. Byte planes of noise repeat in runs or not at all: there zlib's
Z_RLE is twice as fast and packs better. Those of a steady count repeat at a distance, which only the full search finds.
The latter is tried on the first chunk of each block, and, where it does not find much, the former, too; what packs it
better is used for the rest of it.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import h5py
import numpy as np
import numpy.typing as npt

from benchctl.recordings.digests import SampleDigest, blocks
from benchctl.recordings.schema import CHUNK, DEFLATE_LEVEL
from benchctl.side_by_side import cores, in_order
from benchctl_instruments.arrays import FloatArray

_BLOCK = 32 * CHUNK
"""Samples of one task, 4 MiB; as many tasks as cores are in memory at once, and a few more."""
_SHORT = 4 * CHUNK
_RUNS, _ALL = zlib.Z_RLE, zlib.Z_DEFAULT_STRATEGY
_REPEATS = 12
"""The full search that packs so many times has found what repeats at a distance; runs alone would take more of both."""


@dataclass(frozen=True, slots=True)
class _Piece:
    """Samples that go into a dataset from `start` on, in chunks of so many."""

    dataset: h5py.Dataset
    start: int
    chunk: int
    samples: FloatArray


def write_samples(
    datasets: Mapping[str, h5py.Dataset], channels: Mapping[str, FloatArray | h5py.Dataset]
) -> dict[str, str]:
    """Fill datasets as `create_channels` makes them, from arrays or from datasets of another file, block by block.

    Returns the digest of each channel's samples. Raises `OSError` where the disk refuses.
    """
    digests = {name: SampleDigest(len(dataset)) for name, dataset in datasets.items()}
    is_short = all(len(dataset) <= _SHORT for dataset in datasets.values())  # to start a thread would take as long
    for piece, chunks in in_order(_packed, _pieces(datasets, channels, digests), 1 if is_short else cores()):
        for number, chunk in enumerate(chunks):
            piece.dataset.id.write_direct_chunk((piece.start + number * piece.chunk,), chunk)
    return {name: digest.hexdigest() for name, digest in digests.items()}


def _pieces(
    datasets: Mapping[str, h5py.Dataset],
    channels: Mapping[str, FloatArray | h5py.Dataset],
    digests: Mapping[str, SampleDigest],
) -> Iterator[_Piece]:
    """All samples in order, digested as they pass."""
    for name, dataset in datasets.items():
        for part in blocks(len(dataset), _BLOCK):
            samples = np.ascontiguousarray(channels[name][part], dtype="<f8")
            digests[name].update(samples)
            yield _Piece(dataset, part.start, dataset.chunks[0], samples)


def _packed(piece: _Piece) -> tuple[_Piece, list[bytes]]:
    return piece, packed(piece.samples, piece.chunk)


def packed(samples: FloatArray, chunk: int) -> list[bytes]:
    """The chunks of samples, shape (n,), shuffled and deflated; the last one filled up with zeros."""
    planes = _shuffled(samples, chunk)
    first = next(planes)
    best, there = _ALL, _deflated(first, _ALL)
    if len(there) * _REPEATS > first.nbytes and len(runs := _deflated(first, _RUNS)) < len(there):
        best, there = _RUNS, runs
    return [there, *(_deflated(each, best) for each in planes)]


def _shuffled(samples: FloatArray, chunk: int) -> Iterator[npt.NDArray[np.uint8]]:
    """Each chunk's first bytes, then its second ones, …: shape (8, chunk)."""
    for start in range(0, len(samples), chunk):
        piece = samples[start : start + chunk]
        planes = np.zeros((8, chunk), dtype=np.uint8)
        planes[:, : len(piece)] = piece.view(np.uint8).reshape(-1, 8).T
        yield planes


def _deflated(planes: npt.NDArray[np.uint8], strategy: int) -> bytes:
    compressor = zlib.compressobj(DEFLATE_LEVEL, strategy=strategy)
    return compressor.compress(planes.data) + compressor.flush()
