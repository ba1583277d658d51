"""Suggest a known name for a misspelt one."""

from __future__ import annotations

from collections.abc import Iterable


def meant(name: str, names: Iterable[str], otherwise: str = "") -> str:
    """Return the end of an error message: the closest name, else `otherwise`, else all names.

    >>> meant("pionts", ["points", "soak_s"])
    'did you mean points?'
    >>> meant("x", ["points", "soak_s"])
    'there are points, soak_s'
    """
    known = tuple(names)
    close = nearest(name, known)
    if close:
        return f"did you mean {close}?"
    return otherwise or there_are(known)


def there_are(names: Iterable[str]) -> str:
    """Return a text that lists all names."""
    return f"there are {listed}" if (listed := ", ".join(names)) else "there are none"


def nearest(name: str, names: Iterable[str]) -> str:
    """Return the closest of some names, regardless of case; empty if none is close."""
    import difflib

    by_small = {known.lower(): known for known in names}
    close = difflib.get_close_matches(name.lower(), by_small, 1)
    return by_small[close[0]] if close else ""
