"""The heaps in which HDF5 keeps texts and names, walked before HDF5 does: in damaged ones the library goes on for ever.

    | "GCOL" | version 1, 1 | reserved 3 | bytes of the heap 8 | object | object | ... |      global heap collection
    | index 2 | references 2 | reserved 4 | bytes 8 | data, filled up to a multiple of 8 |   object; index 0: free room

    | "HEAP" | version 0, 1 | reserved 3 | bytes 8 | first free 8 | address of the names 8 | local heap: a group's names
    | next free 8 | bytes 8 |                             a piece of free room among the names; no next one: 1

Found by fuzzing HDF5 2.0.0: an object that says 0 bytes, or so many that its end wraps around, is where it stays; a
piece of free room that names itself as the next one takes memory until there is none.
Source: HDF5 File Format Specification 3.0, III.D and III.E.
"""

from __future__ import annotations

import struct
from pathlib import Path

_SIGNATURE = b"GCOL\x01\0\0\0"
_HEAD = struct.Struct("<8sQ")
_OBJECT = struct.Struct("<H6xQ")
_NAMES_SIGNATURE = b"HEAP\0\0\0\0"
_NAMES_HEAD = struct.Struct("<8sQQQ")
_FREE = struct.Struct("<QQ")
_FILE_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MOST_PIECES = 1 << 19
"""Heaps of names and their pieces of free room: ten times as many as a recording has steps."""
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
    _check_names(content)


def _check_names(content: bytes) -> None:
    """Only what never ends is refused: a heap may be one that is no longer used, with anything where its names were."""
    base = _base_of(content)
    place = content.find(_NAMES_SIGNATURE)
    pieces = 0
    while place >= 0:
        pieces += 1 + _free_pieces(content, base, place)
        if pieces > _MOST_PIECES:
            raise ValueError("its names are damaged: there is more free room among them than any recording has")
        place = content.find(_NAMES_SIGNATURE, place + 1)


def _free_pieces(content: bytes, base: int, start: int) -> int:
    """How many pieces of free room are linked in a heap of names, as far as they can be followed."""
    if start + _NAMES_HEAD.size > len(content):
        return 0
    _, size, free, address = _NAMES_HEAD.unpack_from(content, start)
    seen: set[int] = set()
    while 1 < free < size and base + address + free + _FREE.size <= len(content):
        if free in seen or len(seen) > _MOST_PIECES:
            raise ValueError(f"its names are damaged at byte {base + address + free}")
        seen.add(free)
        free, _ = _FREE.unpack_from(content, base + address + free)
    return len(seen)


def _base_of(content: bytes) -> int:
    """Where addresses count from: HDF5 begins at byte 0 or behind a block of the user's of 512 · 2ⁿ bytes."""
    base = 0
    while not content.startswith(_FILE_SIGNATURE, base) and base < len(content):
        base = 2 * base or 512
    return base if base < len(content) else 0


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
