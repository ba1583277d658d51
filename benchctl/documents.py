"""JSON and TOML text into plain values, whatever the text: every fault is one line, and no text is slow or deep."""

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
"""Dotted parts, more than a key may have, wherever they stand. No part can begin within another: one pass is enough."""


def read_json(path: Path, what: str) -> Any:
    """What a file of JSON stands for; `what` is its role in an error.

    Raises
    ------
    UsageError
        Where it cannot be read, and whatever `json_document` raises.
    """
    return json_document(read_whole(path, MOST_DESCRIPTION_BYTES, f"{what} "), f"{what} {path}")


def json_document(text: bytes | str, name: str) -> Any:
    """What a JSON text stands for; `name` is its place in an error.

    Raises
    ------
    UsageError
        Not UTF-8, not JSON (names the line), nested too deep, or with whole numbers beyond 64 bits.
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
    """What a TOML text stands for; `name` is its place in an error.

    Raises
    ------
    UsageError
        Not TOML (names the line), too large, nested too deep, keys of too many parts, whole numbers beyond 64 bits.
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
    """A value as JSON can hold it: what is not finite becomes null, paths and keys become texts."""
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
    """Raise `UsageError` where a document is too deep to be written again, or its numbers are too wide."""
    waiting: list[tuple[object, int]] = [(document, 0)]
    while waiting:
        value, depth = waiting.pop()
        if isinstance(value, dict | list):
            if depth >= MOST_DEPTH:
                raise UsageError(f"{name}: nested too deep, expected at most {MOST_DEPTH} levels")
            inner = value.values() if isinstance(value, dict) else value
            waiting.extend((item, depth + 1) for item in inner)
        elif isinstance(value, int) and abs(value) > LARGEST_WHOLE_NUMBER:
            raise UsageError(f"{name}: holds a whole number of {value.bit_length()} bits, expected at most 64")
