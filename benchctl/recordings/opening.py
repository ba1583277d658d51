"""Makes HDF5 files with room on the disk for what is put into them, and opens those that grow.

A write that the file system refuses leaves HDF5's cache in a state in which closing the file, or the end of the
program, crashes (HDF5 2.0.0). So whoever writes reserves the bytes first: no space, a quota or a limit on the size of
files then is an `OSError`, of which HDF5 notices nothing.

A growing file is opened without HDF5's own locks. HDF5 locks a file while it is made or opened, and refuses whoever
comes meanwhile: a viewer that found a step's file in the moment in which the runner made it would stop the run. Who may
write a campaign is settled by the campaign's own lock (`benchctl.locks`). A finished file is locked as h5py does:
within one process HDF5 opens a file only in one way.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

import h5py

from benchctl.atomic import beside, require_room
from benchctl.confined import hdf5_name

FINISHED_LIBVER = ("v108", "v110")
"""The oldest and newest HDF5 format features that a finished file may use."""

_SWMR_LIBVER = ("v110", "v110")
_OWN_RECORDS = 1 << 20
"""Bytes that HDF5 needs at most beside the samples that are put in at once: groups, attributes, indices of chunks."""


def create_hdf5(path: Path, *, growing: bool = False) -> h5py.File:
    """A new file, in place of one that is there, with its groups in the order in which they are made.

    `growing`: for SWMR, and whoever has it open does not matter. Raises `OSError` where the disk refuses.
    """
    trial = beside(path)
    try:
        with trial.open("wb") as empty:  # once HDF5 has made a file, it must be able to write the file's first bytes
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
        file.flush()  # what a crash leaves begins with a superblock
        reserve(file, 0)
    except BaseException:
        file.close()
        raise
    return file


def reserve(file: h5py.File, size: int) -> None:
    """Allocate `size` more bytes on the disk for a file that is being written, and those of HDF5's own records.

    Raises `OSError` where the file system refuses them, and what `require_room` raises; the file is as it was. On a
    system without `posix_fallocate` (Windows, macOS) only the free space is looked at.
    """
    require_room(Path(file.filename), size)
    _allocate(file.id.get_vfd_handle(), file.id.get_filesize(), size + _OWN_RECORDS)


def _allocate(descriptor: int, start: int, size: int) -> None:
    if not hasattr(os, "posix_fallocate"):
        return
    try:
        os.posix_fallocate(descriptor, start, size)
    except OSError as err:
        if err.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # this file system cannot allocate beforehand
            raise


def give_back(path: Path) -> None:
    """Give back what was reserved for a finished, closed file: HDF5 cuts off what it finds beyond the end."""
    with h5py.File(path, "r+", libver=FINISHED_LIBVER):
        pass


def open_closed(path: Path) -> h5py.File:
    """A file that nobody writes, open for reading; raises what `h5py.File` and `benchctl.confined` raise."""
    with hdf5_name(path) as name:
        return h5py.File(name, "r")


def open_growing(path: Path) -> h5py.File:
    """A file that another process may be writing, open for reading under SWMR; raises what `h5py.File` raises.

    Where a header fails its checksum HDF5 reads it again, a hundred times, waiting twice as long each time: for a
    damaged file that is for ever. `hdf5_trial` finds such a file.
    """
    with hdf5_name(path) as name:
        return h5py.File(name, "r", swmr=True, locking=False)
