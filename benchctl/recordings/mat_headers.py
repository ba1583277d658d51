"""What a MAT file of version 5 to 7 says of its variables, read with nothing but the bytes that are needed for it.

    | text 116 | subsystem 8 | version 2 | IM or MI 2 |           header: 128 bytes; IM is little-endian
    | type 4 | bytes 4 | data ... |                               element; up to 4 bytes: | bytes 2, type 2 | data 4 |
    miMATRIX (14): array flags (6: class in the low byte), dimensions (5), name (1), then the numbers
    miCOMPRESSED (15): a zlib stream that unpacks to a miMATRIX

scipy reads the numbers. It believes the sizes in these headers, and follows cells and structures as deep as they go,
where the stack of the program may end; so nothing is given to it before each header was held against the bytes that are
there. Source: MathWorks, MAT-File Format (2019), chapter 1.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from benchctl.limits import FREE_BYTES, MOST_INFLATION

_INT8, _INT32, _UINT32, _MATRIX, _COMPRESSED = 1, 5, 6, 14, 15
_NUMBER_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
"""Types of numbers as they are stored -> bytes each."""
_NUMERIC_CLASSES = range(6, 16)
"""mxDOUBLE to mxUINT64; others are cells, structures, objects, text, sparse matrices, functions."""

_HEADER_BYTES = 128
_LONGEST_NAME = 255
"""MATLAB's own limit is 63."""
_LOOKED_AT = 512
"""Bytes of a variable that hold everything but its numbers."""
_MOST_DIMENSIONS = 8


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable by its header; `numeric` is a full matrix of real numbers."""

    name: str
    shape: tuple[int, ...]
    numeric: bool

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return math.prod(self.shape)


def variables_in(file: BinaryIO) -> Iterator[Variable]:
    """The variables of a file that is open at its beginning.

    Raises `ValueError`, in a few words, where a header is not as MATLAB writes it, or promises more than the file has.
    """
    header = file.read(_HEADER_BYTES)
    order = {b"IM": "<", b"MI": ">"}.get(header[126:128])
    if order is None:
        raise ValueError("its header is none of version 5 to 7")
    end = file.seek(0, 2)
    position = _HEADER_BYTES
    while position < end:
        file.seek(position)
        kind, length = _unpacked(f"{order}II", file.read(8), 0)
        position += 8 + length
        if position > end or length == 0:
            raise ValueError(f"a variable of {length} bytes does not fit into the {end} bytes of the file")
        if kind == _COMPRESSED:
            start = _inflated(file, length)
            inner, most = _unpacked(f"{order}II", start, 0)
            if inner != _MATRIX or most > FREE_BYTES + MOST_INFLATION * length:
                raise ValueError(f"{length} packed bytes promise {most} bytes of type {inner}")
            yield _variable(start[8:], order, most)
        elif kind == _MATRIX:
            yield _variable(file.read(min(length, _LOOKED_AT)), order, length)
        else:
            raise ValueError(f"a variable of type {kind}, expected a matrix")


def _inflated(file: BinaryIO, length: int) -> bytes:
    """The first bytes of what is packed."""
    try:
        return zlib.decompressobj().decompress(file.read(min(length, 2 * _LOOKED_AT)), _LOOKED_AT)
    except zlib.error as err:
        raise ValueError(f"a packed variable is damaged: {err}") from err


def _variable(data: bytes, order: str, length: int) -> Variable:
    """A variable from its first bytes; `length` is what it promises to have."""
    kind, flags, position = _element(data, 0, order)
    if kind != _UINT32 or len(flags) != 8:
        raise ValueError("a variable begins without its flags")
    (flag_word,) = struct.unpack_from(f"{order}I", flags)
    kind, dims, position = _element(data, position, order)
    if kind != _INT32 or not 2 <= len(dims) // 4 <= _MOST_DIMENSIONS or len(dims) % 4:
        raise ValueError("a variable without a shape")
    shape = struct.unpack(f"{order}{len(dims) // 4}i", dims)
    kind, name, position = _element(data, position, order)
    if kind != _INT8 or len(name) > _LONGEST_NAME or min(shape) < 0:
        raise ValueError(f"a variable of shape {shape} with a name of {len(name)} bytes")
    numeric = flag_word & 0xFF in _NUMERIC_CLASSES and not flag_word & 0x0800  # 0800h: complex
    found = Variable(name.decode("latin-1"), shape, numeric)
    if numeric:
        _check_numbers(found, data[position:], order, length - position)
    return found


def _check_numbers(variable: Variable, data: bytes, order: str, left: int) -> None:
    """The numbers are as many as the shape says, and fit into what is left of the variable."""
    word, length = _unpacked(f"{order}II", data, 0)
    if word >> 16:  # a short element
        word, length = word & 0xFFFF, word >> 16
    each = _NUMBER_BYTES.get(word)
    if each is None or length != each * variable.size or length > left:
        raise ValueError(f"{variable.name} of shape {variable.shape} has {length} bytes of type {word}")


def _element(data: bytes, position: int, order: str) -> tuple[int, bytes, int]:
    """Type and data of an element, and where the next one begins."""
    kind, length = _unpacked(f"{order}II", data, position)
    if kind >> 16:  # a short element: its data stand where the length would
        kind, length, start, after = kind & 0xFFFF, kind >> 16, position + 4, position + 8
    else:
        start, after = position + 8, position + 8 + length + -length % 8
    if length > len(data) - start or (start == position + 4 and length > 4):
        raise ValueError("a variable ends within its header")
    return kind, data[start : start + length], after


def _unpacked(layout: str, data: bytes, position: int) -> tuple[int, int]:
    if len(data) < position + 8:
        raise ValueError("a variable ends within its header")
    first, second = struct.unpack_from(layout, data, position)
    return int(first), int(second)
