"""Reads samples that HDF5's own filters packed (shuffle, deflate) without HDF5's lock, so that all cores can unpack.

HDF5 reads and inflates one chunk after the other, and h5py lets no second thread in meanwhile. Here a chunk is fetched
as it lies in the file, which is a copy, and inflated and put in order outside the lock. Whatever is not packed in just
this way, or looks odd in any respect, is left to h5py: it reads all that HDF5 can, and its errors say what is wrong.
"""

from __future__ import annotations

import zlib

import h5py
import numpy as np

from benchctl_instruments.arrays import FloatArray

_PACKED = [h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE]
_BYTES = 8


def read_samples(dataset: h5py.Dataset, start: int, stop: int) -> FloatArray:
    """The samples `start:stop` of a channel that `hdf5_guard.check_samples` has passed; raises what h5py raises."""
    samples = np.empty(stop - start)
    fill(dataset, start, samples)
    return samples


def fill(dataset: h5py.Dataset, start: int, samples: FloatArray) -> None:
    """As `read_samples`, into an array that is there."""
    if samples.size and not (_is_packed(dataset) and _unpack(dataset, start, samples)):
        with np.errstate(invalid="ignore"):  # of a signalling NaN in another type
            samples[:] = dataset[start : start + samples.size]


def _is_packed(dataset: h5py.Dataset) -> bool:
    """Whether all chunks should be little-endian float64, shuffled and then deflated."""
    if dataset.chunks is None or dataset.dtype != np.dtype("<f8"):
        return False
    storage = dataset.id.get_create_plist()
    return [storage.get_filter(number)[0] for number in range(storage.get_nfilters())] == _PACKED


def _unpack(dataset: h5py.Dataset, start: int, samples: FloatArray) -> bool:
    """Fill the samples from `start` on; False where a chunk is not what it should be."""
    size = dataset.chunks[0]
    for first in range(start - start % size, start + samples.size, size):
        try:
            chunk = dataset.id.get_chunk_info_by_coord((first,))
            if chunk.byte_offset is None or chunk.filter_mask:  # never written, or not packed
                return False
            packed = zlib.decompressobj()  # which stops where a chunk is full, however much it would blow up to
            planes = packed.decompress(dataset.id.read_direct_chunk((first,))[1], size * _BYTES + 1)
        except (MemoryError, OSError, RuntimeError, ValueError, zlib.error):
            return False
        if len(planes) != size * _BYTES or not packed.eof:
            return False
        skipped, place = max(start - first, 0), max(first - start, 0)
        piece = samples[place : place + size - skipped]
        places = piece.view(np.uint8).reshape(-1, _BYTES)
        for number, plane in enumerate(np.frombuffer(planes, np.uint8).reshape(_BYTES, size)):
            places[:, number] = plane[skipped : skipped + piece.size]
    return True
