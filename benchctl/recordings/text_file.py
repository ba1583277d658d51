"""The bytes of a text file, packed with gzip or not, with a clear word where it is cut short or is no such thing."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import zlib
from collections.abc import Iterable
from pathlib import Path

from benchctl.confined import open_file, stat_of
from benchctl.limits import (
    FREE_BYTES,
    MOST_DESCRIPTION_BYTES,
    MOST_LINE_BYTES,
    MOST_TEXT_INFLATION,
    require_file,
    require_memory,
)
from benchctl_instruments.errors import UsageError, reason

_GZIP_MAGIC = b"\x1f\x8b"
_BLOCK = 1 << 20
_MEMORY_PER_BYTE = 5
"""Text is held about twice, its numbers twice more, and at times marks of where each of them stands."""


def read_bytes(path: Path) -> bytes:
    r"""The text of a file as bytes, lines ended by ``\n``, without a byte order mark.

    Raises
    ------
    UsageError
        Where it cannot be read, is empty, is more than this machine could hold, has a line that no table has, or its
        gzip stream is cut short, damaged, or blows up to what no table becomes.
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
    """The bytes of a description (JSON); raises `UsageError` where it cannot be read, is empty or far too large."""
    raw = _raw(path, MOST_DESCRIPTION_BYTES)
    if not raw.strip():
        raise UsageError(f"{path}: the file is empty; expected a description in JSON")
    return raw.removeprefix(b"\xef\xbb\xbf")


def sources_json(paths: Iterable[Path]) -> str:
    """Names, sizes and SHA-256 of the files that an import read, as JSON, for the provenance."""
    found = {}
    for path in paths:
        with open_file(path) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            found[path.name] = {"bytes": file.tell(), "sha256": digest}
    return json.dumps(found)


def _raw(path: Path, most_bytes: int | None = None) -> bytes:
    """The bytes as they stand: as many as the file says that it has."""
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
            while part := stream.read1(_BLOCK):  # gives what there is before it complains
                parts.append(part)
                size += len(part)
                require_memory(path, _MEMORY_PER_BYTE * size, "its unpacked text")
                if size > most:
                    raise UsageError(
                        f"{path}: {len(packed)} bytes of gzip become more than {most}, which no table of numbers does; "
                        "unpack it yourself where it is one all the same"
                    )
    except EOFError as err:
        whole = sum(part.count(b"\n") for part in parts)
        raise UsageError(f"{path}: the gzip stream is cut short after line {whole}; copy the file again") from err
    except (gzip.BadGzipFile, zlib.error) as err:
        raise UsageError(f"{path}: not a sound gzip file ({err}); copy the file again") from err
    return b"".join(parts)


def _refuse_long_lines(path: Path, text: bytes) -> None:
    """Raise `UsageError` where a line, its end included, is longer than `MOST_LINE_BYTES`; names the line."""
    start = 0
    while start < len(text):
        end = text.rfind(b"\n", start, start + MOST_LINE_BYTES)
        if end < 0:
            number = text.count(b"\n", 0, start) + 1
            raise UsageError(
                f"{path}, line {number}: is longer than {MOST_LINE_BYTES} bytes; expected rows of numbers, one a line"
            )
        start = end + 1
