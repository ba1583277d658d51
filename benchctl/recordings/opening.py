"""Create HDF5 files with reserved disk space, open files that grow, and read samples.

A write that the file system refuses leaves HDF5's cache in a state in which closing the file, or the end of the
program, crashes (HDF5 2.0.0). Therefore the bytes are reserved before they are written: no space, a quota or a limit on
the size of files is then an `OSError`, which HDF5 does not notice.

A growing file is opened without HDF5's own locks. HDF5 locks a file while it is created or opened, and refuses all
others meanwhile: a viewer that opened a step's file at the moment of its creation would stop the run. The campaign's
own lock decides who may write it (`benchctl.locks`). A finished file is locked as h5py does: within one process HDF5
opens a file only in one way.

Samples that HDF5's own filters packed (shuffle, deflate) are read without HDF5's lock, so that all cores can unpack.
HDF5 reads and inflates one chunk after the other, and h5py blocks other threads meanwhile. Here a chunk is read as it
is stored, which is a copy, and inflated and unshuffled outside the lock. Anything that is not packed in exactly this
way, or is unusual in any respect, is left to h5py: it reads everything that HDF5 can, and its errors state the reason.
"""

from __future__ import annotations

import errno
import os
import zlib
from pathlib import Path

import h5py
import numpy as np

from benchctl.atomic import require_room, temporary_path
from benchctl.confined import hdf5_name
from benchctl_instruments.arrays import FloatArray

FINISHED_LIBVER = ("v108", "v110")
"""The oldest and newest HDF5 format features that a finished file may use."""

_SWMR_LIBVER = ("v110", "v110")
_OWN_RECORDS = 1 << 20
"""Maximum bytes that HDF5 needs in addition to the samples of one write: groups, attributes, indices of chunks."""


def create_hdf5(path: Path, *, growing: bool = False) -> h5py.File:
    """Create a new file, in place of an existing one; its groups keep the order of their creation.

    `growing`: for SWMR, even if other processes have the file open. Raises `OSError` if the disk refuses.
    """
    trial = temporary_path(path)
    try:
        with trial.open("wb") as empty:  # once HDF5 has created a file, it must be able to write its first bytes
            _allocate(empty.fileno(), 0, _OWN_RECORDS)
    finally:
        trial.unlink(missing_ok=True)
    file = h5py.File(
        path,
        "w",
        libver=_SWMR_LIBVER if growing else FINISHED_LIBVER,
        track_order=True,
        locking=False if growing else None,
    )
    try:
        file.flush()  # a file left by a crash begins with a superblock
        reserve(file, 0)
    except BaseException:
        file.close()
        raise
    return file


def reserve(file: h5py.File, size: int) -> None:
    """Reserve `size` more bytes on the disk for a file that is being written, and those of HDF5's own records.

    Raises `OSError` if the file system refuses them, and what `require_room` raises; the file is then unchanged. On a
    system without `posix_fallocate` (Windows, macOS) only the free space is checked.
    """
    require_room(Path(file.filename), size)
    _allocate(file.id.get_vfd_handle(), file.id.get_filesize(), size + _OWN_RECORDS)


def _allocate(descriptor: int, start: int, size: int) -> None:
    if not hasattr(os, "posix_fallocate"):
        return
    try:
        os.posix_fallocate(descriptor, start, size)
    except OSError as err:
        if err.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # this file system cannot reserve space
            raise


def give_back(path: Path) -> None:
    """Release the reserved space of a finished, closed file: HDF5 truncates what is beyond the end."""
    with h5py.File(path, "r+", libver=FINISHED_LIBVER):
        pass


def open_closed(path: Path) -> h5py.File:
    """Open a file that no process writes, for reading; raises what `h5py.File` and `benchctl.confined` raise."""
    with hdf5_name(path) as name:
        return h5py.File(name, "r")


def open_growing(path: Path) -> h5py.File:
    """Open a file that another process may be writing, for reading under SWMR; raises what `h5py.File` raises.

    If a header fails its checksum, HDF5 reads it again, a hundred times, waiting twice as long each time: for a damaged
    file this never ends. `hdf5_guard.require_harmless` finds such a file.
    """
    with hdf5_name(path) as name:
        return h5py.File(name, "r", swmr=True, locking=False)


_PACKED = [h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE]
_BYTES = 8


def read_samples(dataset: h5py.Dataset, start: int, stop: int) -> FloatArray:
    """Return the samples `start:stop` of a channel that passed `hdf5_guard.check_samples`; raises what h5py raises."""
    samples = np.empty(stop - start)
    fill(dataset, start, samples)
    return samples


def fill(dataset: h5py.Dataset, start: int, samples: FloatArray) -> None:
    """Read samples into an existing array, as `read_samples` does."""
    if samples.size and not (_is_packed(dataset) and _unpack(dataset, start, samples)):
        with np.errstate(invalid="ignore"):  # of a signalling NaN in another type
            samples[:] = dataset[start : start + samples.size]


def _is_packed(dataset: h5py.Dataset) -> bool:
    """Whether all chunks should be little-endian float64, first shuffled and then deflated."""
    if dataset.chunks is None or dataset.dtype != np.dtype("<f8"):
        return False
    storage = dataset.id.get_create_plist()
    return [storage.get_filter(number)[0] for number in range(storage.get_nfilters())] == _PACKED


def _unpack(dataset: h5py.Dataset, start: int, samples: FloatArray) -> bool:
    """Fill the samples from `start` on; return False if a chunk is not as expected."""
    size = dataset.chunks[0]
    for first in range(start - start % size, start + samples.size, size):
        try:
            chunk = dataset.id.get_chunk_info_by_coord((first,))
            if chunk.byte_offset is None or chunk.filter_mask:  # never written, or not packed
                return False
            packed = zlib.decompressobj()  # this stops when a chunk is full, however large it would become
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
