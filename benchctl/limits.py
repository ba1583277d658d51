"""What a file may ask of this program: every limit of the readers, each with its reason.

Files come by mail, from archives and from other benches, and some lie. A reader therefore takes a file's word for
nothing that costs memory or time: sizes are held against the bytes that are really there, and against these limits.
They are generous: 60 hours at 100 kHz, or a recording of 10 GB, stay far below all of them.

What no limit in this process can mend: HDF5 is decoded by a library in C. A damaged file can keep it busy, make it
allocate gigabytes (a text's length stands where Python cannot see it) or end the program. So a child process, whose
memory and time are limited, opens a file from elsewhere first: see `benchctl.recordings.hdf5_guard`. A campaign's
folder is taken for one of this suite's own. Whoever gets one from a stranger copies its `recording.h5` out of it first.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from benchctl.confined import open_file, stat_of
from benchctl_instruments.errors import UsageError, reason

MOST_DESCRIPTION_BYTES = 16 << 20
"""JSON: 50 000 steps at 300 bytes. In memory they are thirty times as large."""

MOST_TOML_BYTES = 150_000
"""TOML is written by hand: a bench.toml has 6000 bytes. Parsing and checking this many takes at most half a second."""

MOST_STEPS = 50_000
"""Steps of a plan: the description of a recording holds no more (`MOST_DESCRIPTION_BYTES`)."""

LONGEST_EXPANSION_S = 2.0
"""Processor time in which a procedure yields all its steps; ours take a hundredth of a second."""

LONGEST_STEP_S = 366 * 86400.0
"""Any duration of a step: a year is longer than any soak."""

MOST_DEPTH = 64
"""Tables in tables, lists in lists; ours are five deep. Python's own limit counts the caller's frames, too."""

MOST_KEY_PARTS = 64
"""Parts of a dotted key. The time that Python's TOML reader takes for one grows with their square."""

LARGEST_WHOLE_NUMBER = 1 << 64
"""No counter on a bench is wider; whole numbers of a million digits are slow to print and fit into no file of ours."""

MOST_COLUMNS = 1 << 20
"""Columns of a table, or of a matrix: a line of `MOST_LINE_BYTES` holds no more."""

MOST_HEADER_LINES = 1 << 20
"""Lines before the samples of a table begin to be split for their names."""

LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 1e-9, 1e12
"""Rates of samples: one in thirty years, and far beyond any converter. Their inverse is an ordinary number."""

LONGEST_TIME_S = 1e12
"""Stamps of foreign clocks: thirty thousand years from their zero. Differences of stamps are ordinary numbers."""

MOST_COUNTS_PER_REV = 1 << 40
"""A count of an encoder of that many would be a millionth of an arc second."""

MOST_JOURNAL_BYTES = 64 << 20
"""A campaign's journal: a year, an event a minute. Also any other text that a recording carries as an attribute."""

MOST_JOURNAL_LINES = 1 << 19
"""The same in lines; each takes ten microseconds to read."""

MOST_LINE_BYTES = 1 << 20
"""A line of delimited text: a hundred thousand columns. The parser takes sixteen bytes for each byte of a line."""

FREE_BYTES = 16 << 20
"""What a compressed file may always become, however small it is."""

MOST_INFLATION = 1100
"""A sample of HDF5 from a byte of its file: DEFLATE (RFC 1951) cannot do better than 1032, on equal samples."""

MOST_TEXT_INFLATION = 300
"""Text from a byte of gzip: columns of numbers give 3 to 30, since the stamps at least change from row to row."""

MOST_CHUNK_BYTES = 1 << 20
"""A chunk of an HDF5 dataset: ours have 128 KiB, h5py's own choice ends at 1 MiB. It bounds what one becomes."""

_MEMORY_SHARE = 0.9
_LONGEST_SHOWN = 60


def memory_bytes() -> int | None:
    """How much memory this machine has; None where the system says so only in its own way (Windows)."""
    if not hasattr(os, "sysconf"):
        return None
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def require_memory(path: Path, size: int, what: str) -> None:
    """Raise `UsageError` where `size` bytes are more than this machine could hold; `what` needs them.

    A system that lends more memory than it has ends the program later, without a word. Where it does not say how much
    it has (Windows) nothing is checked: it does not lend.
    """
    there = memory_bytes()
    if there is not None and size > _MEMORY_SHARE * there:
        raise UsageError(
            f"{path}: {what} needs {size / 1e9:.3g} GB of memory, this machine has {there / 1e9:.3g} GB; "
            "split the recording, or use a larger machine"
        )


def read_whole(path: Path, most_bytes: int, what: str) -> bytes:
    """All bytes of a file, at most `most_bytes`; `what` is its role in an error.

    Raises
    ------
    UsageError
        Where it cannot be read, is no file (a pipe might never end), or goes on beyond that.
    """
    require_file(path, what)
    try:
        with open_file(path) as file:
            content = file.read(most_bytes + 1)
    except OSError as err:
        raise UsageError(f"{what}{path}: cannot be read: {reason(err)}") from err
    except ValueError as err:  # a NUL in the name
        raise UsageError(f"{what}{str(path)!r}: cannot be read: {err}") from err
    if len(content) > most_bytes:
        raise UsageError(f"{what}{path}: is larger than {most_bytes / 1e6:.2g} MB, which no such file needs")
    return content


def require_file(path: Path, what: str = "") -> None:
    """Raise `UsageError` where there is something of that name that is no file, such as a pipe, which might never end.

    Links are followed unless the program is confined to a folder (`benchctl.confined`).
    """
    try:
        mode = stat_of(path).st_mode
    except (OSError, ValueError):  # who opens it says what is wrong
        return
    if not stat.S_ISREG(mode) and not stat.S_ISLNK(mode):  # a link is refused where it is opened
        raise UsageError(f"{what}{path}: cannot be read: it is no file; name one")


def shown(value: object) -> str:
    """A value as an error shows it: `repr`, never longer than a line, whatever the file said."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a whole number, or a nesting, that Python refuses to print
        return f"a {type(value).__name__} too large to be shown"
    return cut(text, _LONGEST_SHOWN)


def cut(text: str, longest: int = 500) -> str:
    """A text as an error repeats it, whoever wrote it."""
    return text if len(text) <= longest else f"{text[: longest - 3]}..."


def listed(names: tuple[str, ...] | list[str]) -> str:
    """Names as an error lists them: the first twenty, none longer than can be read."""
    first = ", ".join(cut(name, _LONGEST_SHOWN) for name in names[:20])
    return f"{first}, and {len(names) - 20} more" if len(names) > 20 else first
