"""Limit what is read from an HDF5 file: nothing outside the file, nothing larger than its bytes can hold.

An HDF5 file can declare that a group is in another file, that samples are in /etc/passwd, that a dataset has 2**60
samples and no bytes, that a chunk is compressed twice, or that an attribute is a thousand times the same text. A
recording needs none of this. Everything here raises `ValueError` with a short text; the callers add the place.

Only what Python can access is checked here. Damage below that (in B-trees, in heaps) is found in a child process: a
file from elsewhere is opened there first, with limited memory and time.

HDF5 is a library in C, which a damaged file can crash, keep busy indefinitely, or cause to allocate gigabytes. The
child opens the file and reads everything except samples; only then does this process open it. Files that this process
wrote, and files in a campaign's folder, are opened without a child, which would take a third of a second per step. For
a step that was being written when its program died, HDF5 would wait for the writer to repair damage: such a file is
checked in a child, too.
"""

from __future__ import annotations

import math
import signal
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchctl.confined import hdf5_name
from benchctl.limits import FREE_BYTES, MOST_CHUNK_BYTES, MOST_INFLATION, MOST_JOURNAL_BYTES, cut
from benchctl.locks import is_held
from benchctl.own_process import limit_itself, peak_bytes, run_limited
from benchctl.recordings.schema import JOURNAL, LOCK, PART_SUFFIX, STEPS
from benchctl_instruments.errors import BenchError

_FILTERS = {h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_FLETCHER32}
_MOST_ARRAY_BYTES = 1 << 16
"""Maximum size of an attribute that is an array: HDF5's own limit for one in the header of its group."""


@contextmanager
def plain_errors() -> Iterator[None]:
    """Convert any exception that h5py raises about a damaged file into a `ValueError` of one line."""
    try:
        yield
    except BenchError:
        raise
    except (ArithmeticError, AttributeError, LookupError, MemoryError, OSError, RuntimeError, TypeError) as err:
        raise ValueError(cut(" ".join(str(err).split())) or type(err).__name__) from err


def child(group: h5py.Group, name: str) -> h5py.Group | h5py.Dataset | h5py.Datatype:
    """Return the item of a group with this name; raises `ValueError` if there is none, or a link to elsewhere."""
    with plain_errors():
        _text(name)
        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink):
            kind = "an external" if isinstance(link, h5py.ExternalLink) else "a soft"
            raise ValueError(f"{cut(name)} is {kind} link: a recording holds what it names itself")
        return group[name]


def child_group(group: h5py.Group, name: str) -> h5py.Group:
    """Return a group as `child` does; raises `ValueError` if it is not a group."""
    found = child(group, name)
    if not isinstance(found, h5py.Group):
        raise ValueError(f"{cut(name)} should be a group and is none")
    return found


def names_in(group: h5py.Group) -> list[str]:
    """Return the names in a group."""
    with plain_errors():
        return [_text(name) for name in group]


def attribute_names(thing: h5py.Group | h5py.Dataset) -> list[str]:
    """Return the names of the attributes."""
    with plain_errors():
        return [_text(name) for name in thing.attrs]


def attributes(thing: h5py.Group | h5py.Dataset, names: Iterable[str]) -> dict[str, Any]:
    """Return these attributes, each as from `attribute`; raises `ValueError` if they are too large together."""
    found: dict[str, Any] = {}
    size = 0
    for name in names:
        found[name] = attribute(thing, name)
        size += len(found[name]) if isinstance(found[name], str) else 0
        if size > 2 * MOST_JOURNAL_BYTES:  # a text may be stored once and referenced by a thousand attributes
            raise ValueError(f"its attributes are more than {2 * MOST_JOURNAL_BYTES / 1e6:.0f} MB of text")
    return found


def attribute(thing: h5py.Group | h5py.Dataset, name: str, default: Any = None) -> Any:
    """Return one attribute as plain text, number or list of numbers; raises `ValueError` if it is anything else."""
    with plain_errors():
        try:
            found = h5py.h5a.open(thing.id, name.encode("utf-8"))
        except KeyError:
            return default
        kind, shape = found.dtype, found.shape
        count = 0 if shape is None else math.prod(shape)
        if h5py.check_string_dtype(kind) is not None:
            if count != 1 or kind.itemsize > MOST_JOURNAL_BYTES:
                raise ValueError(f"the attribute {cut(name)} is {count} texts of {kind.itemsize} bytes, expected one")
        elif kind.kind not in "biuf" or kind.itemsize > 8:
            raise ValueError(f"the attribute {cut(name)} is of type {kind}, expected text or numbers")
        elif not 1 <= count <= _MOST_ARRAY_BYTES // kind.itemsize:
            raise ValueError(f"the attribute {cut(name)} holds {count} numbers, expected one or a few")
        value = np.zeros(shape, dtype=kind)
        found.read(value)
        if kind.kind in "biuf":
            return value.tolist()
        text = value.reshape(-1)[0]
        return _text(text) if isinstance(text, str) else bytes(text).decode("utf-8")


def is_channel(item: object) -> bool:
    """Whether an item of a step is a channel: a dataset of one dimension; other items do not belong to benchctl.

    A virtual dataset counts as a channel, so that `check_samples` can refuse it: HDF5 opens its sources merely to
    return its shape.
    """
    with plain_errors():
        if not isinstance(item, h5py.Dataset):
            return False
        return item.id.get_create_plist().get_layout() == h5py.h5d.VIRTUAL or len(item.shape or ()) == 1


def length_of(dataset: h5py.Dataset) -> int:
    """Return the number of samples of a channel; raises `ValueError` as `check_samples` does."""
    check_samples(dataset)
    return int(dataset.shape[0])


def check_samples(dataset: h5py.Dataset) -> None:
    """Raise `ValueError` if a channel is not a column of numbers, is outside the file, or claims more than it has."""
    with plain_errors():
        storage = dataset.id.get_create_plist()
        if storage.get_layout() not in (h5py.h5d.COMPACT, h5py.h5d.CONTIGUOUS, h5py.h5d.CHUNKED):
            raise ValueError("its samples are virtual, gathered from elsewhere")
        if storage.get_external_count():
            raise ValueError("its samples lie outside the file")
        if dataset.dtype.kind not in "iuf" or dataset.dtype.itemsize > 8:
            raise ValueError(f"holds {dataset.dtype}, expected float64")
        filters = [storage.get_filter(number)[0] for number in range(storage.get_nfilters())]
        if not set(filters) <= _FILTERS or len(set(filters)) < len(filters):
            raise ValueError(
                f"is packed with the HDF5 filters {filters}, expected gzip and shuffle; repack it (h5repack)"
            )
        stored = min(dataset.id.get_storage_size(), dataset.file.id.get_filesize())
        claimed = dataset.shape[0] * dataset.dtype.itemsize
        inflation = MOST_INFLATION if h5py.h5z.FILTER_DEFLATE in filters else 1
        if claimed > FREE_BYTES + inflation * stored:
            raise ValueError(f"claims {dataset.shape[0]} samples, which its {stored} bytes cannot hold")
        if dataset.chunks is not None:
            _check_chunks(dataset, dataset.chunks[0] * dataset.dtype.itemsize, packed=bool(filters))


def _check_chunks(dataset: h5py.Dataset, chunk_bytes: int, *, packed: bool) -> None:
    """Raise `ValueError` if a chunk or its compressed bytes are too large: a chunk is inflated at once."""
    if chunk_bytes > MOST_CHUNK_BYTES:
        raise ValueError(
            f"has chunks of {chunk_bytes} bytes, expected at most {MOST_CHUNK_BYTES}; repack it (h5repack)"
        )
    if not packed or not hasattr(dataset.id, "chunk_iter"):  # h5py with an HDF5 before 1.14 cannot check this
        return
    largest = 0

    def look(chunk: Any) -> None:
        nonlocal largest
        largest = max(largest, chunk.size)

    dataset.id.chunk_iter(look)
    if largest > chunk_bytes + chunk_bytes // 8 + 1024:  # more than deflate adds to noise
        raise ValueError(f"has a chunk of {largest} bytes that is to become {chunk_bytes}")


def _text(text: str) -> str:
    """Return the text; raises `ValueError` if it is not UTF-8, as h5py returns such bytes as lone surrogates."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError as err:
        raise ValueError(f"{cut(text)!r} is no UTF-8") from err
    return text


_MEMORY_BYTES = 1 << 30
"""Address space of the child beyond that at its start; a recording of 500 steps takes 40 MB."""
_PEAK_BYTES = 1 << 29
"""Memory in use; HDF5 takes more only for a damaged file, and stops at the limit of the address space."""
_LEAST_S, _MOST_S, _BYTES_PER_S = 5.0, 120.0, 2e6
"""Limits of processor time, and bytes per second; a recording is read ten times faster than this."""
_WAITS_S = 20
"""Wall time for a step that no process writes any more; HDF5 needs a tenth of a second."""

_Stamp = tuple[int, int, int, int]
_known: set[_Stamp] = set()
_ended: set[Path] = set()


def is_own(path: Path) -> bool:
    """Whether a file is in a campaign's folder, or unchanged since this process wrote it or a child read it."""
    if "\0" in str(path):  # there is no such file, as opening it will report
        return True
    campaign = path.parent.parent
    if path.name.endswith(PART_SUFFIX) and (campaign in _ended or not is_held(campaign / LOCK)):
        return _stamp(path) in _known
    return (path.parent / JOURNAL).exists() or path.parent.name == STEPS or _stamp(path) in _known


def note_ended(campaign: Path) -> None:
    """Note that no process writes the steps of a campaign; this process has its lock in order to repair them."""
    _ended.add(campaign)


def note_own(path: Path) -> None:
    """Note that a file needs no child as long as it is not changed."""
    _known.add(_stamp(path))


def require_harmless(path: Path) -> None:
    """Raise `ValueError` if HDF5 crashes on a file, or needs more memory or time than any recording takes.

    A file that is not HDF5 passes; raises `OSError` as `benchctl.confined.open_file` does.
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
    """Read everything in a file except samples; return the exit status: 1 if this took too much memory.

    With `waits_s` the file is one that grows, and a signal ends the process after this time. Other errors in the file
    are left to the parent.
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
