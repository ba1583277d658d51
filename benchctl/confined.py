"""Open files for reading. A process confined to a folder opens no files outside and follows no symbolic links.

Results may come from other machines, and a link in them may point to any file of this machine. Therefore the live page
confines itself to the folder that it serves, and all readers open files with this module. Below that folder, each part
of a path is opened relative to the previous part and never through a link (openat, O_NOFOLLOW), so that a link created
at any moment is refused too. On systems without these calls (Windows), the path is checked before it is opened.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

_READ = os.O_RDONLY | getattr(os, "O_BINARY", 0)
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)  # opening a pipe does not wait for its writer
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0)
_STEPWISE = os.open in os.supports_dir_fd and hasattr(os, "O_NOFOLLOW")

_roots: list[Path] = []
"""The folder to which this process is confined; empty if it is not confined."""
_own: list[Path] = []
"""Folders of the program itself."""


def confine(root: Path, *own: Path) -> None:
    """Confine this process to files below `root`, without symbolic links, and to the program's own files below `own`.

    This applies until the process ends. The path of `root` itself may contain links.
    """
    _roots[:] = [root.resolve()]
    _own[:] = [Path(os.path.abspath(folder)) for folder in own]


def open_file(path: Path) -> BufferedReader:
    """Open a file for reading; raise OSError as `open` does, and if the file is outside the confinement."""
    return os.fdopen(descriptor_of(path), "rb")


def descriptor_of(path: Path) -> int:
    """Return a descriptor of a file, opened as by `open_file`; the caller closes it."""
    if not _roots or _is_own(path):
        return os.open(path, _READ)
    descriptor = _opened(path, _READ | _AT_ONCE)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is no file")
    return descriptor


@contextmanager
def hdf5_name(path: Path) -> Iterator[Path]:
    """Yield a path by which a library opens exactly the present file at `path`; raise OSError as `open_file` does."""
    if not _roots or _is_own(path):
        yield path
        return
    descriptor = descriptor_of(path)
    try:
        yield Path(f"/dev/fd/{descriptor}") if _STEPWISE else path
    finally:
        os.close(descriptor)


def entries_in(folder: Path) -> dict[str, bool]:
    """Return the names in a folder, with true for each folder that is not a link.

    Raises OSError, if the process is confined, for a link or a folder outside the confinement.
    """
    if _roots:
        _require_inside(folder)
    descriptor = _opened(folder, _FOLDER) if _roots and _STEPWISE else None
    try:
        with os.scandir(folder if descriptor is None else descriptor) as found:
            return {entry.name: entry.is_dir(follow_symlinks=False) for entry in found}
    finally:
        if descriptor is not None:
            os.close(descriptor)


def walk(
    root: Path, onerror: Callable[[OSError], object] = lambda err: None
) -> Iterator[tuple[Path, list[str], list[str]]]:
    """Walk like `os.walk` from the top down, without following links; `onerror` is called with each OSError."""
    waiting = [root]
    while waiting:
        place = waiting.pop()
        try:
            entries = entries_in(place)
        except OSError as err:
            err.filename = str(place)
            onerror(err)
            continue
        folders = [name for name, is_folder in entries.items() if is_folder]
        yield place, folders, [name for name, is_folder in entries.items() if not is_folder]
        waiting += [place / name for name in reversed(folders)]


def stat_of(path: Path) -> os.stat_result:
    """Return the status of a path; in a confined process, a link itself is examined, not its target."""
    return path.lstat() if _roots else path.stat()


def _opened(path: Path, flags: int) -> int:
    place = _require_inside(path)
    if not _STEPWISE:
        return os.open(place, flags)
    descriptor = os.open(_roots[0], _FOLDER)
    *folders, last = place.relative_to(_roots[0]).parts or (".",)
    for name, flag in [*((name, _FOLDER) for name in folders), (last, flags)]:
        above = descriptor
        try:
            descriptor = os.open(name, flag | os.O_NOFOLLOW, dir_fd=above)
        except OSError as err:
            if err.errno == errno.ELOOP or (err.errno == errno.ENOTDIR and _is_link(name, above)):
                raise _link() from err
            raise
        finally:
            os.close(above)
    return descriptor


def _require_inside(path: Path) -> Path:
    """Return the absolute path; raise OSError if it is outside the folder.

    On systems without openat, also raise OSError if it contains a link.
    """
    place = Path(os.path.abspath(path))
    if not place.is_relative_to(_roots[0]):
        raise OSError(errno.EACCES, f"it lies outside {_roots[0]}")
    if not _STEPWISE and place.resolve() != place:
        raise _link()
    return place


def _is_link(name: str, above: int) -> bool:
    return stat.S_ISLNK(os.stat(name, dir_fd=above, follow_symlinks=False).st_mode)


def _link() -> OSError:
    return OSError(errno.ELOOP, "it is, or lies behind, a symbolic link, and the live page follows none")


def _is_own(path: Path) -> bool:
    place = Path(os.path.abspath(path))
    return any(place.is_relative_to(folder) for folder in _own)
