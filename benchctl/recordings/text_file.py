"""Delimited text: the bytes of a file, its columns of numbers, and rows of CSV to be written.

A file may be packed with gzip; a file that is truncated, empty or too large is refused in one line. Reading is fast for
valid files, and names the exact line and column of an error. Writing loses no digit.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import math
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchctl.confined import open_file, stat_of
from benchctl.limits import (
    FREE_BYTES,
    MOST_DESCRIPTION_BYTES,
    MOST_LINE_BYTES,
    MOST_TEXT_INFLATION,
    cut,
    require_file,
    require_memory,
    shown,
)
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError, reason

_GZIP_MAGIC = b"\x1f\x8b"
_BLOCK = 1 << 20
_MEMORY_PER_BYTE = 5
"""Text is held about twice, its numbers twice more, and sometimes an index of the places of the numbers."""


def read_bytes(path: Path) -> bytes:
    r"""Return the text of a file as bytes, lines ended by ``\n``, without a byte order mark.

    Raises
    ------
    UsageError
        It cannot be read, is empty, is more than this machine can hold, has a line that is too long for a table, or its
        gzip stream is truncated, damaged, or becomes larger than any table.
    """
    raw = _raw(path)
    text = _unpack(path, raw) if raw.startswith(_GZIP_MAGIC) or path.suffix == ".gz" else raw
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.removeprefix(b"\xef\xbb\xbf")
    if not text.strip():
        raise UsageError(f"{path}: the file is empty; expected a header line and rows of samples")
    text = text if text.endswith(b"\n") else text + b"\n"
    _refuse_long_lines(path, text)
    return text


def read_json_text(path: Path) -> bytes:
    """Return the bytes of a description (JSON); raises `UsageError` if it cannot be read, is empty or far too large."""
    raw = _raw(path, MOST_DESCRIPTION_BYTES)
    if not raw.strip():
        raise UsageError(f"{path}: the file is empty; expected a description in JSON")
    return raw.removeprefix(b"\xef\xbb\xbf")


def sources_json(paths: Iterable[Path]) -> str:
    """Return names, sizes and SHA-256 of the files that an import read, as JSON, for the provenance."""
    found = {}
    for path in paths:
        with open_file(path) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            found[path.name] = {"bytes": file.tell(), "sha256": digest}
    return json.dumps(found)


def _raw(path: Path, most_bytes: int | None = None) -> bytes:
    """Return the unchanged bytes, as many as the file's size states."""
    require_file(path)
    try:
        size = stat_of(path).st_size
        if most_bytes is not None and size > most_bytes:
            raise UsageError(f"{path}: has {size} bytes, expected at most {most_bytes}, which no description needs")
        require_memory(path, _MEMORY_PER_BYTE * size, "its text")
        with open_file(path) as file:
            return file.read(size)
    except OSError as err:
        raise UsageError(f"{path}: cannot be read: {reason(err)}") from err
    except ValueError as err:  # a NUL in the name
        raise UsageError(f"{str(path)!r}: cannot be read: {err}") from err


def _unpack(path: Path, packed: bytes) -> bytes:
    most = max(FREE_BYTES, MOST_TEXT_INFLATION * len(packed))
    parts: list[bytes] = []
    size = 0
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(packed)) as stream:
            while part := stream.read1(_BLOCK):  # returns the available data before it raises
                parts.append(part)
                size += len(part)
                require_memory(path, _MEMORY_PER_BYTE * size, "its unpacked text")
                if size > most:
                    raise UsageError(
                        f"{path}: {len(packed)} bytes of gzip become more than {most}, which no table of numbers does; "
                        "unpack it yourself where it is one all the same"
                    )
    except EOFError as err:
        lines = sum(part.count(b"\n") for part in parts)
        raise UsageError(f"{path}: the gzip stream is cut short after line {lines}; copy the file again") from err
    except (gzip.BadGzipFile, zlib.error) as err:
        raise UsageError(f"{path}: not a sound gzip file ({err}); copy the file again") from err
    return b"".join(parts)


def _refuse_long_lines(path: Path, text: bytes) -> None:
    """Raise `UsageError` with the line number if a line, including its end, is longer than `MOST_LINE_BYTES`."""
    start = 0
    while start < len(text):
        end = text.rfind(b"\n", start, start + MOST_LINE_BYTES)
        if end < 0:
            number = text.count(b"\n", 0, start) + 1
            raise UsageError(
                f"{path}, line {number}: is longer than {MOST_LINE_BYTES} bytes; expected rows of numbers, one a line"
            )
        start = end + 1


_COMMA, _NEWLINE, _DOT, _MINUS, _ZERO = b",\n.-0"


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Where the numbers are: `header_line` (from 1; 0: no header) has the names, samples begin at `first_line`.

    A blank as delimiter is any run of blanks and tabs; those before the first cell are ignored.
    """

    delimiter: str = ","
    decimal: str = "."
    header_line: int = 1
    first_line: int = 2

    @property
    def separator(self) -> str | None:
        """The argument of `str.split`; None splits at blanks."""
        return None if self.delimiter == " " else self.delimiter


def header_names(path: Path, text: bytes, layout: Layout) -> tuple[str, ...]:
    """Return the names in the header, stripped; empty if there is no header.

    Raises
    ------
    UsageError
        The file ends before the header, or a name occurs twice.
    """
    if layout.header_line == 0:
        return ()
    lines = text.split(b"\n", layout.header_line)
    if len(lines) <= layout.header_line:
        raise UsageError(
            f"{path}: ends before line {layout.header_line}, where the names of the columns should be; "
            "say file.header_line in a map file (--map)"
        )
    line = lines[layout.header_line - 1]
    try:
        names = [name.strip().strip('"') for name in line.decode("utf-8").split(layout.separator)]
    except UnicodeDecodeError:
        names = [name.strip().strip('"') for name in line.decode("latin-1").split(layout.separator)]
    for name, times in Counter(names).items():
        if name and times > 1:
            raise UsageError(f"{path}, line {layout.header_line}: the column {shown(name)} is there twice; rename one")
    return tuple(names)


def read_columns(
    path: Path, text: bytes, layout: Layout, columns: Mapping[str, int], *, width: int | None = None
) -> dict[str, FloatArray]:
    """Return the numbers of some columns, each of shape (rows,).

    Parameters
    ----------
    path, text, layout
        The file, for errors, its bytes (`read_bytes`), and where the numbers are in it.
    columns
        Name -> number of the column, from 0.
    width
        The number of cells that every row must have; None: at least as many as the columns need.

    Raises
    ------
    UsageError
        Names file, line and column of the first cell that is missing, not a number, or not finite.
    """
    body = body_of(path, text, layout)
    use = list(columns.values())
    try:
        table = np.loadtxt(
            io.BytesIO(body),
            delimiter=layout.separator,
            comments=None,
            ndmin=2,
            usecols=None if width is not None else use,
        )
        complaint: Exception | None = None
    except (ValueError, TypeError) as err:  # TypeError: a delimiter that no text can contain
        complaint = err
    else:
        complete = table.shape[0] == body.count(b"\n") and (width is None or table.shape[1] == width)
        if complete and np.isfinite(table).all():
            chosen = table[:, use] if width is not None else table
            packed = np.ascontiguousarray(chosen.T)
            return {name: packed[k] for k, name in enumerate(columns)}
    raise _fault(path, body, layout, columns, width) or UsageError(f"{path}: {cut(str(complaint))}") from complaint


def body_of(path: Path, text: bytes, layout: Layout) -> bytes:
    """Return the rows of samples with a decimal point, without the lines before them and blank lines at the end.

    Raises `UsageError` if there are none.
    """
    start = 0
    for _ in range(layout.first_line - 1):
        start = text.find(b"\n", start) + 1
        if start == 0:
            break
    body = text[start:].rstrip() + b"\n" if start or layout.first_line == 1 else b"\n"
    if body == b"\n":
        raise UsageError(f"{path}: has no samples; expected the first in line {layout.first_line}")
    return body.replace(layout.decimal.encode(), b".") if layout.decimal != "." else body


def _fault(path: Path, body: bytes, layout: Layout, columns: Mapping[str, int], width: int | None) -> UsageError | None:
    """Return the first error; None if a second reading finds none."""
    needed = max(columns.values()) + 1
    for number, line in enumerate(io.BytesIO(body), layout.first_line):
        cells = line.decode("latin-1").removesuffix("\n").split(layout.separator)
        if (width is not None and len(cells) != width) or len(cells) < needed:
            expected = width if width is not None else f"at least {needed}"
            missing = next((name for name, k in columns.items() if k == len(cells)), None)
            short = f": the column {missing} and what follows are missing" if missing and len(cells) < needed else ""
            count = "1 cell" if len(cells) == 1 else f"{len(cells)} cells"
            return UsageError(f"{path}, line {number}: expected {expected} cells, got {count}{short}")
        for name, k in columns.items():
            if (problem := _not_a_number(cells[k])) is not None:
                return UsageError(f"{path}, line {number}, column {name}: {problem}")
    return None


def _not_a_number(cell: str) -> str | None:
    if not cell.strip():
        return "expected a number, the cell is empty"
    try:
        value = float(cell.replace("_", "?"))  # Python accepts 1_000, which is not a number elsewhere
    except ValueError:
        return f"expected a number, got {cell.strip()[:40]!r}"
    return None if math.isfinite(value) else f"expected a finite number, got {cell.strip()[:40]}; leave such rows out"


def printed_decimals(body: bytes, columns: Sequence[str]) -> dict[str, int]:
    """Return the printed decimals of each column for which printing gives the exact text of every row again.

    `body` has already been read as numbers. Columns are left out if their cells differ in decimals, or have exponents,
    plus signs, blanks, leading zeros, or more than 15 digits (the nearest float64 may then print as another text).
    """
    text = np.frombuffer(body, dtype=np.uint8)
    ends = np.flatnonzero((text == _COMMA) | (text == _NEWLINE))
    width = len(columns)
    if ends.size % width:
        return {}
    dots = np.flatnonzero(text == _DOT)
    cell_of_dot = np.searchsorted(ends, dots)
    digit = (text >= _ZERO) & (text <= _ZERO + 9)
    odd = np.flatnonzero(~(digit | (text == _COMMA) | (text == _NEWLINE) | (text == _DOT) | (text == _MINUS)))
    spoilt = set(np.unique(np.searchsorted(ends, odd) % width).tolist())
    starts = np.r_[0, ends[:-1] + 1]
    found = {}
    for k, name in enumerate(columns):
        mine = dots[cell_of_dot % width == k]
        decimals = None if k in spoilt else _decimals(text, starts[k::width], ends[k::width], mine)
        if decimals is not None:
            found[name] = decimals
    return found


def _decimals(text: npt.NDArray[np.uint8], starts: IntArray, ends: IntArray, dots: IntArray) -> int | None:
    """Return the decimals of one column, whose cells are `text[starts:ends]`; None if one cell breaks the pattern."""
    first = starts + (text[starts] == _MINUS)
    if dots.size == 0:
        point, decimals = ends, 0
    elif dots.size == ends.size and bool(np.all((dots > starts) & (dots < ends))):
        after = np.unique(ends - dots - 1)
        if after.size != 1 or after[0] == 0:
            return None
        point, decimals = dots, int(after[0])
    else:
        return None
    digits = point - first
    plain = (digits >= 1) & (digits + decimals <= 15) & ((text[first] != _ZERO) | (digits == 1))
    return decimals if bool(plain.all()) else None


_ROWS = 1 << 13


def csv_rows(
    columns: Sequence[FloatArray], names: Sequence[str], decimals: Mapping[str, int] | None = None
) -> Iterator[bytes]:
    """Yield lines of CSV without a header, many at a time.

    `columns`: arrays of shape (n,), n equal. `decimals`: column -> digits after the point; a column that is not listed
    is printed with enough digits to give the same float64 when they are read (Python's `repr`).
    """
    formats = [f"%.{decimals[name]}f" if decimals and name in decimals else "%r" for name in names]
    line = ",".join(formats) + "\n"
    table = np.column_stack(columns)
    for start in range(0, len(table), _ROWS):
        part = table[start : start + _ROWS]
        yield (line * len(part) % tuple(part.ravel().tolist())).encode()
