"""Which processes have a device open, and which are there at all, by Linux' `/proc`."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
_LONGEST_COMMAND = 80
_PTY_MAJORS = range(136, 144)  # devpts: the slaves of pseudo-terminals


@dataclass(frozen=True, slots=True, kw_only=True)
class Process:
    """A process: its number, and the command that began it."""

    pid: int
    command: str

    def __str__(self) -> str:
        return f"process {self.pid} ({self.command})"


def holders(device: str) -> tuple[list[Process], int]:
    """Who, but for this process, has a device open; and how many processes could not be looked into.

    Of a pseudo-terminal, the process at its other end is no holder.
    """
    try:
        wanted = os.stat(device).st_rdev
    except OSError:
        return [], 0
    found, closed = [], 0
    for folder in _processes():
        if int(folder.name) == os.getpid():
            continue
        try:
            opened = list(_devices(folder / "fd"))
        except PermissionError:
            closed += 1
            continue
        except OSError:  # it has ended
            continue
        if wanted in opened and not (os.major(wanted) in _PTY_MAJORS and _PTMX in opened):
            found.append(Process(pid=int(folder.name), command=_command(folder)))
    return found, closed


def running(name: str, proc: Path = PROC) -> Process | None:
    """A process of that name (the first fifteen letters count), where one runs."""
    for folder in _processes(proc):
        try:
            if (folder / "comm").read_text(encoding="utf-8", errors="replace").strip() == name[:15]:
                return Process(pid=int(folder.name), command=_command(folder))
        except OSError:  # it has ended
            continue
    return None


_PTMX = os.makedev(5, 2) if hasattr(os, "makedev") else -1


def _processes(proc: Path = PROC) -> Iterator[Path]:
    if proc.is_dir():
        yield from (folder for folder in proc.iterdir() if folder.name.isdigit())


def _devices(folder: Path) -> Iterator[int]:
    """The devices behind a process' open files."""
    for link in folder.iterdir():
        try:
            status = link.stat()
        except OSError:  # closed meanwhile, or in another namespace
            continue
        if stat.S_ISCHR(status.st_mode):
            yield status.st_rdev


def _command(folder: Path) -> str:
    try:
        words = (folder / "cmdline").read_bytes().decode("utf-8", "replace").replace("\0", " ").strip()
        words = words or (folder / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        words = ""
    shown = "".join(letter if letter.isprintable() else "?" for letter in words)
    return shown if len(shown) <= _LONGEST_COMMAND else f"{shown[: _LONGEST_COMMAND - 3]}..."
