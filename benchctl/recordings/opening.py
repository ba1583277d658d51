"""Makes HDF5 files, and opens those that grow: a growing file without HDF5's own locks, with which a reader ends a run.

HDF5 locks a file while it is made or opened, and refuses whoever comes meanwhile: a viewer that found a step's file in
the moment in which the runner made it would stop the run. Who may write a campaign is settled by the campaign's own
lock (`benchctl.locks`). A finished file is locked as h5py does: within one process HDF5 opens a file only in one way.
"""

from __future__ import annotations

import ctypes
import os
from contextlib import suppress
from pathlib import Path

import h5py

FINISHED_LIBVER = ("v108", "v110")
"""The oldest and newest HDF5 format features that a finished file may use."""

_SWMR_LIBVER = ("v110", "v110")
_READ_ATTEMPTS = 24
"""The waits between them double from a nanosecond: 17 ms together."""


def create_hdf5(path: Path, *, growing: bool = False) -> h5py.File:
    """A new file, in place of one that is there, with its groups in the order in which they are made.

    `growing`: for SWMR, and whoever has it open does not matter.
    """
    if growing:
        return h5py.File(path, "w", libver=_SWMR_LIBVER, track_order=True, locking=False)
    return h5py.File(path, "w", libver=FINISHED_LIBVER, track_order=True)


def open_growing(path: Path) -> h5py.File:
    """A file that another process may be writing, open for reading under SWMR; raises what `h5py.File` raises.

    Where a header fails its checksum HDF5 reads it again, a hundred times, waiting twice as long each time: for a
    damaged file that is for ever. Far fewer are enough for a writer in mid-flush. h5py has no call for it; HDF5 has
    (H5Pset_metadata_read_attempts), and is asked where the system lets it be found.
    """
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_file_locking(False, True)
    with suppress(AttributeError, OSError):  # not found: Windows, or an h5py that was linked in another way
        set_attempts = ctypes.CDLL(h5py.h5p.__file__).H5Pset_metadata_read_attempts
        set_attempts.argtypes = (ctypes.c_int64, ctypes.c_uint)
        set_attempts(access.id, _READ_ATTEMPTS)
    flags = h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ
    return h5py.File(h5py.h5f.open(os.fsencode(path), flags, fapl=access))
