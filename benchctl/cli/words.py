"""Quantities as people read them."""

from __future__ import annotations


def duration(seconds: float) -> str:
    """A time with the two units that matter.

    >>> duration(108000.0), duration(95.4), duration(3.21)
    ('30 h 00 min', '1 min 35 s', '3.2 s')
    """
    if seconds < 60:
        return f"{seconds:.1f} s"
    if seconds < 3600:
        return f"{int(seconds // 60)} min {int(seconds % 60):02d} s"
    return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60):02d} min"


def size(count: float) -> str:
    """A number of bytes.

    >>> size(123456789.0)
    '123.5 MB'
    """
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.4g} {unit}"
        count /= 1000
    return f"{count:.4g} GB"
