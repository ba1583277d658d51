"""Limits on input files: every limit of the readers, each with its reason.

Files may come from e-mail, archives or other benches, and may be damaged or hostile. Before a reader spends memory or
time, it compares the sizes stated in a file with the number of bytes present and with these limits. The limits are
generous: 60 hours at 100 kHz, or a recording of 10 GB, are far below all of them.

These limits cannot protect the library in C that decodes HDF5. A damaged file can keep it busy, make it allocate
gigabytes (the length of a text is not accessible from Python) or crash the program. Therefore a child process with
limited memory and time opens foreign files first: see `benchctl.recordings.hdf5_guard`. A campaign's folder is assumed
to be written by this suite; from an untrusted one, copy `recording.h5` to another place before opening it.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from benchctl.confined import open_file, stat_of
from benchctl_instruments.errors import UsageError, reason

MOST_DESCRIPTION_BYTES = 16 << 20
"""JSON: 50 000 steps of 300 bytes each. They take thirty times as much memory."""

MOST_TOML_BYTES = 150_000
"""TOML files are written manually: a bench.toml has 6000 bytes. Parsing and checking a file of this size takes at most
half a second."""

MOST_STEPS = 50_000
"""Number of steps of a plan: the description of a recording has no room for more (`MOST_DESCRIPTION_BYTES`)."""

LONGEST_STEP_S = 366 * 86400.0
"""Longest duration of a step: a year is longer than any soak."""

MOST_DEPTH = 64
"""Depth of nested tables and lists; our files use five levels. Python's own limit includes the caller's frames."""

MOST_KEY_PARTS = 64
"""Parts of a dotted key. The parsing time of Python's TOML reader grows with the square of this number."""

LARGEST_WHOLE_NUMBER = 1 << 64
"""No counter on a bench is wider. Integers of a million digits are slow to print and fit into none of our files."""

MOST_COLUMNS = 1 << 20
"""Columns of a table or a matrix: a line of `MOST_LINE_BYTES` has no room for more."""

MOST_HEADER_LINES = 1 << 20
"""Lines before the samples of a table that are searched for column names."""

LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 1e-9, 1e12
"""Sample rates: one sample in thirty years, and far above any converter. Their inverses are of ordinary size."""

LONGEST_TIME_S = 1e12
"""Time stamps of foreign clocks: thirty thousand years from zero. Differences of stamps are of ordinary size."""

MOST_COUNTS_PER_REV = 1 << 40
"""One count of such an encoder would be about a millionth of an arc second."""

MOST_JOURNAL_BYTES = 64 << 20
"""A campaign's journal: one event per minute for a year. Also any other text stored as an attribute of a recording."""

MOST_JOURNAL_LINES = 1 << 19
"""The same limit in lines; each line takes ten microseconds to read."""

MOST_LINE_BYTES = 1 << 20
"""A line of delimited text: a hundred thousand columns. The parser needs sixteen bytes per byte of a line."""

FREE_BYTES = 16 << 20
"""Decompressed size that is always allowed, even for the smallest compressed file."""

MOST_INFLATION = 1100
"""Compression ratio of HDF5 samples: DEFLATE (RFC 1951) reaches at most 1032, on equal samples."""

MOST_TEXT_INFLATION = 300
"""Compression ratio of gzip text: columns of numbers reach 3 to 30, since at least the stamps differ between rows."""

MOST_CHUNK_BYTES = 1 << 20
"""Size of a chunk of an HDF5 dataset: our chunks have 128 KiB, h5py chooses at most 1 MiB. It limits the decompressed
size of a chunk."""

_MEMORY_SHARE = 0.9
_LONGEST_SHOWN = 60


def memory_bytes() -> int | None:
    """Return the memory of this machine in bytes; None if `os.sysconf` is not available (Windows)."""
    if not hasattr(os, "sysconf"):
        return None
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def require_memory(path: Path, size: int, what: str) -> None:
    """Raise `UsageError` if `size` bytes, needed by `what`, are more than the memory of this machine.

    A system that overcommits memory would otherwise kill the program later without a message. Windows, where nothing is
    checked, does not overcommit.
    """
    there = memory_bytes()
    if there is not None and size > _MEMORY_SHARE * there:
        raise UsageError(
            f"{path}: {what} needs {size / 1e9:.3g} GB of memory, this machine has {there / 1e9:.3g} GB; "
            "split the recording, or use a larger machine"
        )


def read_whole(path: Path, most_bytes: int, what: str) -> bytes:
    """Return all bytes of a file, at most `most_bytes`; `what` is its role in an error message.

    Raises
    ------
    UsageError
        If it cannot be read, is not a regular file (a pipe might never end), or is larger.
    """
    require_file(path, what)
    try:
        with open_file(path) as file:
            content = file.read(most_bytes + 1)
    except OSError as err:
        raise UsageError(f"{what}{path}: cannot be read: {reason(err)}") from err
    except ValueError as err:  # a NUL character in the name
        raise UsageError(f"{what}{str(path)!r}: cannot be read: {err}") from err
    if len(content) > most_bytes:
        raise UsageError(f"{what}{path}: is larger than {most_bytes / 1e6:.2g} MB, which no such file needs")
    return content


def require_file(path: Path, what: str = "") -> None:
    """Raise `UsageError` if the path is not a regular file, such as a pipe, which might never end.

    A path that does not exist is accepted. Links are followed unless the process is confined (`benchctl.confined`).
    """
    try:
        mode = stat_of(path).st_mode
    except (OSError, ValueError):  # opening the file will report the error
        return
    if not stat.S_ISREG(mode) and not stat.S_ISLNK(mode):  # a link is refused where it is opened
        raise UsageError(f"{what}{path}: cannot be read: it is no file; name one")


def shown(value: object) -> str:
    """Return the `repr` of a value for an error message, never longer than a line."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer or a nesting that Python refuses to print
        return f"a {type(value).__name__} too large to be shown"
    return cut(text, _LONGEST_SHOWN)


def cut(text: str, longest: int = 500) -> str:
    """Return a text, shortened to `longest` characters, for an error message."""
    return text if len(text) <= longest else f"{text[: longest - 3]}..."


def printable(text: str) -> str:
    """Return a text from a file for one line: shortened, with ? for characters that cannot be printed."""
    return cut("".join(letter if letter.isprintable() else "?" for letter in text))


def listed(names: tuple[str, ...] | list[str]) -> str:
    """Return a list of names for an error message: the first twenty, each shortened if too long."""
    first = ", ".join(cut(name, _LONGEST_SHOWN) for name in names[:20])
    return f"{first}, and {len(names) - 20} more" if len(names) > 20 else first
