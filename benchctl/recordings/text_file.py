"""The bytes of a text file, packed with gzip or not, with a clear word where it is cut short or is no such thing."""

from __future__ import annotations

import gzip
import hashlib
import json
import zlib
from collections.abc import Iterable
from pathlib import Path

from instruments.errors import UsageError

_GZIP_MAGIC = b"\x1f\x8b"


def read_bytes(path: Path) -> bytes:
    r"""The text of a file as bytes, lines ended by ``\n``, without a byte order mark.

    Raises
    ------
    UsageError
        Where it cannot be read, is empty, or its gzip stream is cut short or damaged.
    """
    try:
        raw = path.read_bytes()
    except OSError as err:
        raise UsageError(f"{path}: cannot be read: {err.strerror or err}") from err
    text = _unpack(path, raw) if raw.startswith(_GZIP_MAGIC) or path.suffix == ".gz" else raw
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.removeprefix(b"\xef\xbb\xbf")
    if not text.strip():
        raise UsageError(f"{path}: the file is empty; expected a header line and rows of samples")
    return text if text.endswith(b"\n") else text + b"\n"


def sources_json(paths: Iterable[Path]) -> str:
    """Names, sizes and SHA-256 of the files that an import read, as JSON, for the provenance."""
    found = {}
    for path in paths:
        content = path.read_bytes()
        found[path.name] = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    return json.dumps(found)


def _unpack(path: Path, packed: bytes) -> bytes:
    try:
        return gzip.decompress(packed)
    except EOFError as err:
        whole = _lines_before_the_cut(packed)
        raise UsageError(f"{path}: the gzip stream is cut short after line {whole}; copy the file again") from err
    except (gzip.BadGzipFile, zlib.error) as err:
        raise UsageError(f"{path}: not a sound gzip file ({err}); copy the file again") from err


def _lines_before_the_cut(packed: bytes) -> int:
    """How many whole lines the stream still gives."""
    return zlib.decompressobj(wbits=31).decompress(packed).count(b"\n")
