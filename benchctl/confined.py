"""Open files for reading; once a program is confined to a folder, none outside it and none through a symbolic link.

Results come from other machines, and a link in them may name any file of this one. So the live page confines itself to
the folder that it serves, and all readers open files here. Below that folder each part of a path is opened relative to
the part before it and never as a link (openat, O_NOFOLLOW): a link that is swapped in at any moment is refused, too.
Where the system has no such calls (Windows) the path is checked before it is opened.
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
"""The folder to which this process is confined; empty where it is not."""
_own: list[Path] = []
"""Folders of the program itself."""


def confine(root: Path, *own: Path) -> None:
    """From now on open only files below `root`, without symbolic links, and the program's own ones below `own`.

    It holds for the whole process and until its end. `root` itself may be reached through links.
    """
    _roots[:] = [root.resolve()]
    _own[:] = [Path(os.path.abspath(folder)) for folder in own]


def open_file(path: Path) -> BufferedReader:
    """A file, open for reading; OSError as for `open`, and for whatever a confined program does not open."""
    return os.fdopen(descriptor_of(path), "rb")


def descriptor_of(path: Path) -> int:
    """As `open_file`, as a descriptor that the caller closes."""
    if not _roots or _is_own(path):
        return os.open(path, _READ)
    descriptor = _opened(path, _READ | _AT_ONCE)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is no file")
    return descriptor


@contextmanager
def hdf5_name(path: Path) -> Iterator[Path]:
    """A name under which a library opens exactly the file that `path` is now; OSError as for `open_file`."""
    if not _roots or _is_own(path):
        yield path
        return
    descriptor = descriptor_of(path)
    try:
        yield Path(f"/dev/fd/{descriptor}") if _STEPWISE else path
    finally:
        os.close(descriptor)


def entries_in(folder: Path) -> dict[str, bool]:
    """The names in a folder, and whether each is a folder and no link; OSError where it is a link or lies outside."""
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
    """As `os.walk` from the top down, without following links; `onerror` is called with what a folder refuses."""
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
    """Size, time and kind of what is at a path; of a link itself where the program is confined."""
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
    """The whole path, which lies below the folder and, where it cannot be opened part by part, leads over no link."""
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
