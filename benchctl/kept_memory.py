"""Memory that a process keeps for its next large arrays, rather than hand it back and get it anew.

The GNU C library asks the system for the pages of every array above 32 MB, and gives them back with it. The system
clears them each time: that is more than a quarter of the processor time of a diagnosis of ten million rows.
"""

from __future__ import annotations

import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8
"""Options of mallopt(3), as malloc.h numbers them."""


def keep_memory() -> bool:
    """Let this process keep what memory it has had, to its end; whether its C library can.

    Only for a process of its own that does one large piece of work: what it no longer needs, no other gets. To be
    called before it has any thread beside the first: the C library looks but once how many may have memory apart.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except AttributeError:
        return False
    # no array in pages of its own, none given back, and all threads share what there is
    return all([mallopt(_MMAP_MAX, 0), mallopt(_TRIM_THRESHOLD, -1), mallopt(_ARENA_MAX, 1)])
