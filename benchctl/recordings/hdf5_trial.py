"""Opens an HDF5 file from elsewhere in a child process first, whose memory and time are limited.

HDF5 is decoded by a library in C, which a damaged file can crash, keep busy for ever, or make allocate gigabytes. The
child opens the file and reads all that is not samples; only then does this process open it. What this process wrote,
and what lies in a campaign's folder, is opened without: no child may cost a third of a second a step. Of a step that
was being written when its program died HDF5 would wait for the writer to mend what is damaged: it is tried, too.
"""

from __future__ import annotations

import signal
import sys
from contextlib import suppress
from pathlib import Path

import h5py

from benchctl.confined import hdf5_name
from benchctl.locks import is_held
from benchctl.own_process import limit_itself, peak_bytes, run_limited
from benchctl.recordings.hdf5_guard import attribute, attribute_names, check_samples
from benchctl.recordings.schema import JOURNAL, LOCK, PART_SUFFIX, STEPS

_MEMORY_BYTES = 1 << 30
"""Address space beyond what the child has when it begins; a recording of 500 steps takes 40 MB."""
_PEAK_BYTES = 1 << 29
"""Memory in use; HDF5 takes more only of a damaged file, and stops at the limit of the address space."""
_LEAST_S, _MOST_S, _BYTES_PER_S = 5.0, 120.0, 2e6
"""Processor time; a recording is read at ten times this rate."""
_WAITS_S = 20
"""Wall time for a step that nobody writes any more; HDF5 needs a tenth of a second."""

_Stamp = tuple[int, int, int, int]
_known: set[_Stamp] = set()
_ended: set[Path] = set()


def is_own(path: Path) -> bool:
    """Whether a file lies in a campaign's folder, or is as this process wrote it, or as it was when a child read it."""
    if "\0" in str(path):  # there is no such file, as opening it says
        return True
    campaign = path.parent.parent
    if path.name.endswith(PART_SUFFIX) and (campaign in _ended or not is_held(campaign / LOCK)):
        return _stamp(path) in _known
    return (path.parent / JOURNAL).exists() or path.parent.name == STEPS or _stamp(path) in _known


def note_ended(campaign: Path) -> None:
    """Note that nobody writes the steps of a campaign, whose lock this process has to put them in order."""
    _ended.add(campaign)


def note_own(path: Path) -> None:
    """Note that a file needs no child as long as it is not changed."""
    _known.add(_stamp(path))


def require_harmless(path: Path) -> None:
    """Raise `ValueError` where HDF5 crashes on a file, or needs more memory or time than any recording takes.

    A file that is no HDF5 passes; `OSError` as for `benchctl.confined.open_file`.
    """
    waits_s = _WAITS_S if path.name.endswith(PART_SUFFIX) else 0
    limit_s = min(_MOST_S, _LEAST_S + path.stat().st_size / _BYTES_PER_S)
    with hdf5_name(path) as name:
        if not waits_s and not h5py.is_hdf5(name):
            return
        descriptors = () if name == path else (int(name.name),)
        status, _ = run_limited(__name__, [str(name), str(limit_s), str(waits_s)], limit_s, pass_fds=descriptors)
    if status:
        raise ValueError(
            f"HDF5 crashes on it, or takes more than {limit_s:.0f} s or {_PEAK_BYTES / 1e6:.0f} MB for its structure"
        )
    note_own(path)


def main(path: str, limit_s: float, waits_s: int) -> int:
    """Read all of a file that is not samples; returns the exit status: 1 where it took too much memory.

    With `waits_s` it is one that grows, and the process ends by a signal once that has passed. Whatever else is wrong
    with the file is for the parent to say.
    """
    if waits_s and sys.platform != "win32":
        signal.alarm(waits_s)
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
        with h5py.File(path, "r", swmr=bool(waits_s), locking=False if waits_s else None) as file:
            look("", file)
            file.visititems(look)
    except (OSError, RuntimeError, ValueError, LookupError, TypeError, MemoryError) as err:
        refusals.append(str(err))
    return int(peak_bytes() > _PEAK_BYTES or any("alloc" in refusal for refusal in refusals))


def _stamp(path: Path) -> _Stamp:
    found = path.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3])))
