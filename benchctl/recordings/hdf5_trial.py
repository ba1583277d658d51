"""Opens an HDF5 file from elsewhere in a child process first, whose memory and time are limited.

HDF5 is decoded by a library in C, which a damaged file can crash, keep busy for ever, or make allocate gigabytes. The
child opens the file and reads all that is not samples; only then does this process open it. What this process wrote,
and what lies in a campaign's folder, is opened without: no child may cost a third of a second a step.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import h5py

from benchctl.confined import hdf5_name
from benchctl.own_process import limit_itself, peak_bytes, run_limited
from benchctl.recordings.hdf5_guard import attribute, attribute_names, check_samples
from benchctl.recordings.schema import JOURNAL, STEPS

_MEMORY_BYTES = 1 << 30
"""Address space beyond what the child has when it begins; a recording of 500 steps takes 40 MB."""
_PEAK_BYTES = 1 << 29
"""Memory in use; HDF5 takes more only of a damaged file, and stops at the limit of the address space."""
_LEAST_S, _MOST_S, _BYTES_PER_S = 5.0, 120.0, 2e6
"""Processor time; a recording is read at ten times this rate."""

_Stamp = tuple[int, int, int, int]
_known: set[_Stamp] = set()


def is_own(path: Path) -> bool:
    """Whether a file lies in a campaign's folder, or is as this process wrote it, or as it was when a child read it."""
    if "\0" in str(path):  # there is no such file, as opening it says
        return True
    return (path.parent / JOURNAL).exists() or path.parent.name == STEPS or _stamp(path) in _known


def note_own(path: Path) -> None:
    """Note that a file needs no child as long as it is not changed."""
    _known.add(_stamp(path))


def require_harmless(path: Path) -> None:
    """Raise `ValueError` where HDF5 crashes on a file, or needs more memory or time than any recording takes.

    A file that is no HDF5 passes; `OSError` as for `benchctl.confined.open_file`.
    """
    limit_s = min(_MOST_S, _LEAST_S + path.stat().st_size / _BYTES_PER_S)
    with hdf5_name(path) as name:
        if not h5py.is_hdf5(name):
            return
        descriptors = () if name == path else (int(name.name),)
        status, _ = run_limited(__name__, [str(name), str(limit_s)], limit_s, pass_fds=descriptors)
    if status:
        raise ValueError(
            f"HDF5 crashes on it, or takes more than {limit_s:.0f} s or {_PEAK_BYTES / 1e6:.0f} MB for its structure"
        )
    note_own(path)


def main(path: str, limit_s: float) -> int:
    """Read all of a file that is not samples; returns the exit status: 1 where it took too much memory.

    Whatever else is wrong with the file is for the parent to say.
    """
    limit_itself(limit_s, _MEMORY_BYTES)
    refusals: list[str] = []

    def look(_: str, thing: h5py.Group | h5py.Dataset | h5py.Datatype) -> None:
        try:
            for name in attribute_names(thing):
                with suppress(ValueError):
                    attribute(thing, name)
            if isinstance(thing, h5py.Dataset):
                check_samples(thing)
        except ValueError as err:
            refusals.append(str(err))

    try:
        with h5py.File(path, "r") as file:
            look("", file)
            file.visititems(look)
    except (OSError, RuntimeError, ValueError, LookupError, TypeError, MemoryError) as err:
        refusals.append(str(err))
    return int(peak_bytes() > _PEAK_BYTES or any("alloc" in refusal for refusal in refusals))


def _stamp(path: Path) -> _Stamp:
    found = path.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], float(sys.argv[2])))
