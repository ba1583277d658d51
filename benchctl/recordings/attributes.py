"""Writes attributes as `thing.attrs[name] = value` does, in half the time: a step has a hundred, and its file two.

h5py works out the type and the shape of each anew. Ours are scalars of three types, known beforehand: so what will be
read of them is known, too, and a seal need not read it.
"""

from __future__ import annotations

import h5py
import numpy as np
from h5py import h5a, h5s, h5t

from benchctl.recordings.opening import reserve

Plain = str | int | float
"""An attribute as it is written and read."""

_TEXT = h5py.string_dtype()
_TEXT_TYPE = h5t.py_create(_TEXT, logical=True)
_LONG = 4096
"""Bytes of a text for which room is reserved; shorter ones are among HDF5's own records."""
_SCALAR = h5s.create(h5s.SCALAR)


def plain(value: str | float) -> Plain:
    """The value as it will be read once it is written: a truth is a whole number, 0 or 1."""
    if isinstance(value, str):
        return value
    return int(value) if isinstance(value, bool | int | np.integer) else float(value)


def write_attribute(thing: h5py.Group | h5py.Dataset, name: str, value: str | float) -> None:
    """Write a new attribute, as `plain` makes it: UTF-8 text, int64 or float64.

    Raises `ValueError` or `OverflowError` where HDF5 cannot keep the value, and what `reserve` raises.
    """
    kept = plain(value)
    if isinstance(kept, str):
        size = len(kept.encode("utf-8"))  # h5py would write halves of characters as bytes that nobody can read
        if size > _LONG:
            reserve(thing.file, 2 * size)
        kind, stored = _TEXT_TYPE, np.array(kept, dtype=_TEXT)
    elif isinstance(kept, int):
        kind, stored = h5t.STD_I64LE, np.array(np.int64(kept))
    else:
        kind, stored = h5t.IEEE_F64LE, np.array(np.float64(kept))
    h5a.create(thing.id, name.encode("utf-8"), kind, _SCALAR).write(stored)
