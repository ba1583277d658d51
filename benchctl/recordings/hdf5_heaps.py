"""The heaps in which HDF5 keeps texts, walked before HDF5 does: in a damaged one the library goes round for ever.

    | "GCOL" | version 1, 1 | reserved 3 | bytes of the heap 8 | object | object | ... |      global heap collection
    | index 2 | references 2 | reserved 4 | bytes 8 | data, filled up to a multiple of 8 |   object; index 0: free room

Found by fuzzing HDF5 2.0.0: an object that says 0 bytes, or so many that its end wraps around, is where it stays.
Source: HDF5 File Format Specification 3.0, III.E.
"""

from __future__ import annotations

import struct
from pathlib import Path

_SIGNATURE = b"GCOL\x01\0\0\0"
_HEAD = struct.Struct("<8sQ")
_OBJECT = struct.Struct("<H6xQ")
_LOOKED_AT = 64 << 20
"""Bytes of a file that are searched, 30 ms: the texts of a recording stand with its first steps."""


def check_heaps(path: Path) -> None:
    """Raise `ValueError` where a heap cannot be walked from its beginning to its end."""
    with path.open("rb") as file:
        content = file.read(_LOOKED_AT)
    place = content.find(_SIGNATURE)
    while place >= 0:
        _walk(content, place)
        place = content.find(_SIGNATURE, place + 1)


def _walk(content: bytes, start: int) -> None:
    if start + _HEAD.size > len(content):
        return
    _, size = _HEAD.unpack_from(content, start)
    end = start + size
    if end > len(content):
        if len(content) < _LOOKED_AT:
            raise ValueError(f"its texts at byte {start} are cut short, or damaged")
        return
    position = start + _HEAD.size
    while position + _OBJECT.size <= end:
        index, length = _OBJECT.unpack_from(content, position)
        step = _OBJECT.size + length + -length % 8 if index else length
        if not 0 < step <= end - position:
            raise ValueError(f"its texts are damaged at byte {position}")
        position += step
