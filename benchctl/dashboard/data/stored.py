"""A channel in a closed file: any range of it, read without HDF5's library.

h5py allows one thread at a time in the library, which also decompresses there; threads would wait for each other, and
every request for them. Therefore the positions of the chunks are read from HDF5 once; later the chunks are read from
the file and decompressed here by zlib and numpy, on all cores. Channels with another storage layout are read by h5py.
"""

from __future__ import annotations

import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
import numpy.typing as npt

from benchctl.confined import descriptor_of, stat_of
from benchctl.recordings.hdf5_guard import child, child_group, length_of, plain_errors
from benchctl.recordings.opening import open_closed, open_growing
from benchctl.recordings.schema import group_name
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

_PLAIN = [h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE]
_ITEM = 8


class ChangedError(Exception):
    """The file was changed or replaced in the meantime and has to be read again."""


class Samples(Protocol):
    """A sequence of numbers of which any range can be read."""

    @property
    def length(self) -> int:
        """The number of samples."""

    def read(self, first: int, end: int) -> FloatArray:
        """Return the samples from `first` to `end` (exclusive), shape (end - first,)."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """Distinguishes a file from a later one with the same name."""

    size: int
    mtime_ns: int

    @classmethod
    def of(cls, path: Path) -> Stamp:
        """Return the stamp of a file; raises OSError if it does not exist."""
        found = stat_of(path)
        return cls(found.st_size, found.st_mtime_ns)


def samples_of(path: Path, file: h5py.File, index: int, name: str, stamp: Stamp, *, growing: bool = False) -> Samples:
    """Return a channel of a step, as far as it is written; its file, open now, may be closed afterwards.

    Raises `UsageError` if there is none, or if it is damaged.
    """
    try:
        dataset = child(child_group(file, group_name(index)), name)
        length = length_of(dataset)
        with plain_errors():
            table = None if growing else _chunk_table(dataset, stamp)
    except ValueError as err:
        raise UsageError(f"{path}: step {index} cannot be read: channel {name}: {err}") from err
    if table is None:
        return _ByLibrary(path, index, name, length, None if growing else stamp)
    return _Chunks(path, length, dataset.chunks[0], table, stamp)


def _chunk_table(dataset: h5py.Dataset, stamp: Stamp) -> npt.NDArray[np.int64] | None:
    """Return position and size of each chunk in the file, shape (chunks, 2); None for another storage layout."""
    storage = dataset.id.get_create_plist()
    filters = [storage.get_filter(number)[0] for number in range(storage.get_nfilters())]
    if dataset.chunks is None or filters != _PLAIN or dataset.dtype != np.dtype("<f8"):
        return None
    if not hasattr(dataset.id, "chunk_iter"):
        return None
    (chunk,) = dataset.chunks
    table = np.full((-(-dataset.shape[0] // chunk), 2), -1, dtype=np.int64)
    odd = False

    def look(info: Any) -> None:
        nonlocal odd
        number, rest = divmod(info.chunk_offset[0], chunk)
        odd |= bool(rest or info.filter_mask or info.byte_offset + info.size > stamp.size)
        if number < len(table):
            table[number] = info.byte_offset, info.size

    dataset.id.chunk_iter(look)
    return None if odd or (table < 0).any() else table


class _Chunks:
    """A channel in shuffled and deflated chunks, as in benchctl files."""

    def __init__(self, path: Path, length: int, chunk: int, table: npt.NDArray[np.int64], stamp: Stamp) -> None:
        self._path, self._length, self._chunk, self._table, self._stamp = path, length, chunk, table, stamp

    @property
    def length(self) -> int:
        return self._length

    def read(self, first: int, end: int) -> FloatArray:
        found = np.empty(end - first, dtype="<f8")
        if end <= first:
            return found
        try:
            descriptor = descriptor_of(self._path)
        except OSError as err:
            raise ChangedError(self._path) from err
        try:
            now = os.fstat(descriptor)
            if Stamp(now.st_size, now.st_mtime_ns) != self._stamp:
                raise ChangedError(self._path)
            for number in range(first // self._chunk, -(-end // self._chunk)):
                begins = number * self._chunk
                low, high = max(first, begins), min(end, begins + self._chunk)
                shuffled = self._inflated(descriptor, number)[:, low - begins : high - begins]
                bytes_of = found[low - first : high - first].view(np.uint8).reshape(-1, _ITEM)
                for place in range(_ITEM):
                    bytes_of[:, place] = shuffled[place]
        finally:
            os.close(descriptor)
        return found

    def _inflated(self, descriptor: int, number: int) -> npt.NDArray[np.uint8]:
        """Return a chunk, shape (8, samples), shuffled: the first bytes of all samples, then their second bytes, ..."""
        place, size = (int(item) for item in self._table[number])
        try:
            plain = zlib.decompressobj().decompress(_read_at(descriptor, size, place), self._chunk * _ITEM)
        except zlib.error as err:
            raise self._damaged(number) from err
        if len(plain) != self._chunk * _ITEM:
            raise self._damaged(number)
        return np.frombuffer(plain, dtype=np.uint8).reshape(_ITEM, -1)

    def _damaged(self, number: int) -> UsageError:
        return UsageError(
            f"{self._path}: samples cannot be read: chunk {number} is damaged; benchctl verify {self._path} names all"
        )


def _read_at(descriptor: int, size: int, place: int) -> bytes:
    if hasattr(os, "pread"):
        return os.pread(descriptor, size, place)
    os.lseek(descriptor, place, os.SEEK_SET)
    return os.read(descriptor, size)


class _ByLibrary:
    """A channel with another layout, or a growing one (`stamp` is None), read by h5py; the file is opened each time."""

    def __init__(self, path: Path, index: int, name: str, length: int, stamp: Stamp | None) -> None:
        self._path, self._index, self._name, self._length, self._stamp = path, index, name, length, stamp

    @property
    def length(self) -> int:
        return self._length

    def read(self, first: int, end: int) -> FloatArray:
        try:
            opened = open_growing(self._path) if self._stamp is None else open_closed(self._path)
        except (OSError, RuntimeError) as err:
            raise ChangedError(self._path) from err
        with opened as file:
            if self._stamp is not None and Stamp.of(self._path) != self._stamp:
                raise ChangedError(self._path)
            try:
                with plain_errors(), np.errstate(invalid="ignore"):
                    dataset = child(child_group(file, group_name(self._index)), self._name)
                    found = np.asarray(dataset[first:end], dtype=np.float64)
            except ValueError as err:
                raise UsageError(f"{self._path}: channel {self._name} cannot be read: {err}") from err
        if len(found) < end - first:
            raise ChangedError(self._path)
        return found
