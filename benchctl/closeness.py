"""What somebody meant who wrote a name that there is not."""

from __future__ import annotations

from collections.abc import Iterable


def meant(name: str, names: Iterable[str], otherwise: str = "") -> str:
    """The end of an error's line: the name that is near, else `otherwise`, else all there are.

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
    """All of some names, in words."""
    return f"there are {listed}" if (listed := ", ".join(names)) else "there are none"


def nearest(name: str, names: Iterable[str]) -> str:
    """The one of some names that was probably meant, whatever its case; empty where none is near."""
    import difflib

    by_small = {known.lower(): known for known in names}
    close = difflib.get_close_matches(name.lower(), by_small, 1)
    return by_small[close[0]] if close else ""
