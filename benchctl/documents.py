"""Parse untrusted JSON and TOML text; every fault is reported in one line, and parsing time and depth are limited."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchctl.limits import (
    LARGEST_WHOLE_NUMBER,
    MOST_DEPTH,
    MOST_DESCRIPTION_BYTES,
    MOST_KEY_PARTS,
    MOST_TOML_BYTES,
    read_whole,
)
from benchctl_instruments.errors import UsageError, in_line

_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_LONG_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:[ \t]*\.[ \t]*{_PART}){{{MOST_KEY_PARTS}}}")
"""A sequence of more dotted parts than a key may have. No part can begin within another, so one pass is enough."""


def read_json(path: Path, what: str) -> Any:
    """Return the value of a JSON file; `what` is its role in an error message.

    Raises
    ------
    UsageError
        If it cannot be read, and for the faults listed at `json_document`.
    """
    return json_document(read_whole(path, MOST_DESCRIPTION_BYTES, f"{what} "), f"{what} {path}")


def json_document(text: bytes | str, name: str) -> Any:
    """Return the value of a JSON text; `name` is its source in an error message.

    Raises
    ------
    UsageError
        If it is not UTF-8, not JSON (names the line), nested too deep, or has integers beyond 64 bits.
    """
    _refuse_large(text, name, MOST_DESCRIPTION_BYTES)
    try:
        found = json.loads(text)
    except UnicodeDecodeError as err:
        raise UsageError(f"{name}: expected UTF-8 text, byte {err.start} is not") from err
    except json.JSONDecodeError as err:
        raise UsageError(f"{name}, line {err.lineno}: not JSON: {in_line(err.msg)}") from err
    except (RecursionError, ValueError) as err:  # ValueError: thousands of digits
        raise UsageError(f"{name}: {_too_much(err)}") from err
    _require_plain(found, name)
    return found


def toml_document(text: str, name: str) -> dict[str, Any]:
    """Return the value of a TOML text; `name` is its source in an error message.

    Raises
    ------
    UsageError
        If it is not TOML (names the line), too large, nested too deep, or has keys of too many parts or integers beyond
        64 bits.
    """
    _refuse_large(text, name, MOST_TOML_BYTES)
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise UsageError(f"{name}, line {line}: a key of more than {MOST_KEY_PARTS} parts; nest tables less deep")
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as err:
        raise UsageError(f"{name}: not TOML: {in_line(str(err))}") from err
    except (RecursionError, ValueError, OverflowError) as err:  # ValueError: thousands of digits
        raise UsageError(f"{name}: {_too_much(err)}") from err
    _require_plain(document, name)
    return document


def json_values(value: Any) -> Any:
    """Convert a value for JSON: non-finite numbers become null, paths and keys become strings."""
    if isinstance(value, Mapping):
        return {str(key): json_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def _refuse_large(text: bytes | str, name: str, most: int) -> None:
    if len(text) > most:
        raise UsageError(f"{name}: {len(text)} bytes, expected at most {most}")


def _too_much(err: Exception) -> str:
    if isinstance(err, RecursionError):
        return f"nested too deep, expected at most {MOST_DEPTH} levels"
    return "holds a number with too many digits" if "digit" in str(err) else f"cannot be read: {err}"


def _require_plain(document: object, name: str) -> None:
    """Raise `UsageError` if a document is nested too deep to be written again, or has integers beyond 64 bits."""
    waiting: list[tuple[object, int]] = [(document, 0)]
    while waiting:
        value, depth = waiting.pop()
        if isinstance(value, dict | list):
            if depth >= MOST_DEPTH:
                raise UsageError(f"{name}: nested too deep, expected at most {MOST_DEPTH} levels")
            inner = value.values() if isinstance(value, dict) else value
            waiting.extend((item, depth + 1) for item in inner)
        elif isinstance(value, int) and abs(value) > LARGEST_WHOLE_NUMBER:
            raise UsageError(f"{name}: holds an integer of {value.bit_length()} bits, expected at most 64")
