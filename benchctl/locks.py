"""Locks between processes: one run on a bench, one writer of a campaign.

The operating system holds them, so that a killed process leaves none behind; a lock file that remains means nothing.
A note beside the lock file names the holder. Both may lie in a folder where every user may write: a link in the place
of either is never followed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from filelock import FileLock, Timeout

from benchctl.documents import read_json
from benchctl_instruments.errors import UsageError, reason

_PATIENCE_S = 1.0
"""A process that only looks whether a lock is held holds it for a moment."""


class Lock:
    """A lock on `what` (in words), by the name of a file; held from `acquire` to `release` or to the process' end.

    `was_abandoned` says, once it is acquired, that the last holder ended without releasing it.
    """

    def __init__(self, path: Path, what: str) -> None:
        self.was_abandoned = False
        self._path, self._what = path, what
        self._lock = _file_lock(path)

    def acquire(self, purpose: str, patience_s: float = _PATIENCE_S) -> None:
        """Take the lock, waiting at most `patience_s` for its holder; `purpose` is shown to others.

        Raises `UsageError` where another process has it, naming that process, or where the file system has no locks.
        """
        try:
            self._lock.acquire(timeout=patience_s)
        except Timeout as err:
            raise UsageError(
                f"{self._what} is in use by {_holder(self._path)}; wait until that is over, or stop it"
            ) from err
        except OSError as err:
            raise UsageError(
                f"{self._what} cannot be locked by {self._path}: {reason(err)}; its folder must be writable "
                "and on a file system that has locks"
            ) from err
        note = {"pid": os.getpid(), "purpose": purpose, "since": datetime.now(UTC).isoformat(timespec="seconds")}
        with suppress(OSError):  # the lock itself holds without it
            self.was_abandoned = os.path.lexists(_note(self._path))
            _replace(_note(self._path), json.dumps(note, ensure_ascii=False) + "\n")

    def release(self, *, settled: bool = True) -> None:
        """Give the lock back and remove its files; safe to call twice.

        Unless `settled`, a lock that was abandoned counts as abandoned for the next holder too.
        """
        if not self._lock.is_locked:
            return
        if settled or not self.was_abandoned:
            for file in (_note(self._path), self._path):  # while it is held: afterwards they may be another's
                with suppress(OSError):
                    file.unlink()
        self._lock.release()


@contextmanager
def held(paths: Iterable[Path], what: str, purpose: str, *, settles: bool = True) -> Iterator[bool]:
    """Hold several locks on one thing; yields whether the last holder of any of them ended without releasing it.

    That stays so for the next holder where the block raises, or `settles` is false: it put nothing in order.
    """
    settled = False
    locks = [Lock(path, what) for path in paths]
    try:
        for lock in locks:
            lock.acquire(purpose)
        yield any(lock.was_abandoned for lock in locks)
        settled = settles
    finally:
        for lock in locks:
            lock.release(settled=settled)


def is_held(path: Path) -> bool:
    """Whether any process holds the lock of that name; one that cannot be looked at counts as held."""
    if not path.exists():
        return False
    probe = _file_lock(path)
    try:
        probe.acquire(timeout=0)
    except (Timeout, OSError):
        return True
    probe.release()
    return False


def _file_lock(path: Path) -> FileLock:
    # Every user may open it, for a run of another user must find it held. A soft lock would outlive a killed process.
    return FileLock(path, mode=0o666, thread_local=False, fallback_to_soft=False)


def _note(path: Path) -> Path:
    return path.with_suffix(".json")


def _replace(path: Path, text: str) -> None:
    """Put a new file in the place of whatever has that name."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}.tmp")  # `recover` removes what a death leaves of that name
    with suppress(FileNotFoundError):
        fresh.unlink()
    with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644), "w", encoding="utf-8") as file:
        file.write(text)
    fresh.chmod(0o644)  # whatever the umask: others are to read who holds the lock
    fresh.replace(path)


def _holder(path: Path) -> str:
    try:
        note = read_json(_note(path), "the lock's note")
        return f"process {note['pid']} ({note['purpose']}, since {note['since']})"
    except (UsageError, KeyError, TypeError):
        return "another process"
