"""What of an HDF5 file may be touched: nothing outside the file, nothing larger than its bytes can pay for.

HDF5 lets a file say: this group is in another file, these samples are in /etc/passwd, this dataset has 2**60 samples
and needs no byte, this chunk is compressed twice, this attribute is a thousand times the same text. A recording needs
none of it. Everything here raises `ValueError` in a few words, for its callers to say where.

Only what Python sees is checked. What is damaged below that (its B-trees, its heaps) is found by `hdf5_trial`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import h5py
import numpy as np

from benchctl.limits import FREE_BYTES, MOST_CHUNK_BYTES, MOST_INFLATION, MOST_JOURNAL_BYTES, cut
from benchctl_instruments.errors import BenchError

_FILTERS = {h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_FLETCHER32}
_MOST_ARRAY_BYTES = 1 << 16
"""An attribute that is an array: HDF5's own limit for one that stands in the header of its group."""


@contextmanager
def plain_errors() -> Iterator[None]:
    """Turn whatever h5py raises about a damaged file into a `ValueError` of one line."""
    try:
        yield
    except BenchError:
        raise
    except (ArithmeticError, AttributeError, LookupError, MemoryError, OSError, RuntimeError, TypeError) as err:
        raise ValueError(cut(" ".join(str(err).split())) or type(err).__name__) from err


def child(group: h5py.Group, name: str) -> h5py.Group | h5py.Dataset | h5py.Datatype:
    """What a group holds under this name; `ValueError` where it is not there, or only as a link to elsewhere."""
    with plain_errors():
        _text(name)
        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink):
            kind = "an external" if isinstance(link, h5py.ExternalLink) else "a soft"
            raise ValueError(f"{cut(name)} is {kind} link: a recording holds what it names itself")
        return group[name]


def child_group(group: h5py.Group, name: str) -> h5py.Group:
    """As `child`; `ValueError` where it is no group."""
    found = child(group, name)
    if not isinstance(found, h5py.Group):
        raise ValueError(f"{cut(name)} should be a group and is none")
    return found


def names_in(group: h5py.Group) -> list[str]:
    """The names in a group."""
    with plain_errors():
        return [_text(name) for name in group]


def attribute_names(thing: h5py.Group | h5py.Dataset) -> list[str]:
    """The names of the attributes."""
    with plain_errors():
        return [_text(name) for name in thing.attrs]


def attributes(thing: h5py.Group | h5py.Dataset, names: Iterable[str]) -> dict[str, Any]:
    """These attributes, as `attribute` gives each; `ValueError` where they are too much together."""
    found: dict[str, Any] = {}
    size = 0
    for name in names:
        found[name] = attribute(thing, name)
        size += len(found[name]) if isinstance(found[name], str) else 0
        if size > 2 * MOST_JOURNAL_BYTES:  # a text may be stored once and named by a thousand attributes
            raise ValueError(f"its attributes are more than {2 * MOST_JOURNAL_BYTES / 1e6:.0f} MB of text")
    return found


def attribute(thing: h5py.Group | h5py.Dataset, name: str, default: Any = None) -> Any:
    """One attribute as plain text, number or list of numbers; `ValueError` where it is anything else."""
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
    """Whether something in a step is a channel: a dataset of one dimension; anything else is its owner's.

    A virtual dataset counts as one, for `check_samples` to refuse: HDF5 opens its sources for no more than its shape.
    """
    with plain_errors():
        if not isinstance(item, h5py.Dataset):
            return False
        return item.id.get_create_plist().get_layout() == h5py.h5d.VIRTUAL or len(item.shape or ()) == 1


def length_of(dataset: h5py.Dataset) -> int:
    """The samples of a channel; `ValueError` where they cannot or should not be read: see `check_samples`."""
    check_samples(dataset)
    return int(dataset.shape[0])


def check_samples(dataset: h5py.Dataset) -> None:
    """Raise `ValueError` where a channel is no column of numbers, lies outside the file, or claims more than it has."""
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
    """What is inflated at once is a chunk: neither it nor what stands for it in the file may be large."""
    if chunk_bytes > MOST_CHUNK_BYTES:
        raise ValueError(
            f"has chunks of {chunk_bytes} bytes, expected at most {MOST_CHUNK_BYTES}; repack it (h5repack)"
        )
    if not packed or not hasattr(dataset.id, "chunk_iter"):  # h5py on an HDF5 before 1.14 cannot look
        return
    largest = 0

    def look(chunk: Any) -> None:
        nonlocal largest
        largest = max(largest, chunk.size)

    dataset.id.chunk_iter(look)
    if largest > chunk_bytes + chunk_bytes // 8 + 1024:  # what deflate adds to noise, and more
        raise ValueError(f"has a chunk of {largest} bytes that is to become {chunk_bytes}")


def _text(text: str) -> str:
    """The text, `ValueError` where it is no UTF-8: h5py lets such bytes pass as halves of characters."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError as err:
        raise ValueError(f"{cut(text)!r} is no UTF-8") from err
    return text
