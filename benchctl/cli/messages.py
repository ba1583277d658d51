"""Print lines to stdout or stderr, also when the reader is gone; format durations and sizes."""

from __future__ import annotations

import os
import sys
from typing import TextIO


def duration(seconds: float) -> str:
    """Return a duration in its two largest units.

    >>> duration(108000.0), duration(95.4), duration(3.21)
    ('30 h 00 min', '1 min 35 s', '3.2 s')
    """
    if seconds < 60:
        return f"{seconds:.1f} s"
    if seconds < 3600:
        return f"{int(seconds // 60)} min {int(seconds % 60):02d} s"
    return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60):02d} min"


def size(count: float) -> str:
    """Return a number of bytes as text with a unit.

    >>> size(123456789.0)
    '123.5 MB'
    """
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.4g} {unit}"
        count /= 1000
    return f"{count:.4g} GB"


def tell(text: str, *, err: bool = False) -> None:
    """Print a line on stdout or stderr; if its reader is gone, the program continues."""
    stream = sys.stderr if err else sys.stdout
    try:
        stream.write(f"{text}\n")
        stream.flush()
    except OSError:
        let_go(stream)


def let_go(stream: TextIO) -> None:
    """Discard all further output of a stream whose window was closed or whose pipe has no reader."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
