"""Locks between processes: one run on a bench, one writer of a campaign.

The operating system holds the locks and releases them when a process is killed; a remaining lock file has no meaning.
A note next to the lock file names the holder. Both may be in a folder where every user may write; a link that replaces
one of them is never followed.
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
"""A process that only tests a lock holds it for a moment."""


class Lock:
    """A lock, identified by the path of a file; held from `acquire` to `release` or to the end of the process.

    `what` describes the locked object in error messages. After `acquire`, `was_abandoned` is true if the last holder
    ended without releasing the lock.
    """

    def __init__(self, path: Path, what: str) -> None:
        self.was_abandoned = False
        self._path, self._what = path, what
        self._lock = _file_lock(path)

    def acquire(self, purpose: str, patience_s: float = _PATIENCE_S) -> None:
        """Acquire the lock, waiting at most `patience_s` for its holder; `purpose` is shown to others.

        Raises `UsageError` if another process holds it, naming that process, or if the file system has no locks.
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
        with suppress(OSError):  # the lock works without the note
            self.was_abandoned = os.path.lexists(_note(self._path))
            _replace(_note(self._path), json.dumps(note, ensure_ascii=False) + "\n")

    def release(self, *, settled: bool = True) -> None:
        """Release the lock and remove its files; safe to call twice.

        Unless `settled`, a lock that was abandoned counts as abandoned for the next holder too.
        """
        if not self._lock.is_locked:
            return
        if settled or not self.was_abandoned:
            for file in (_note(self._path), self._path):  # while held: later they may be another process'
                with suppress(OSError):
                    file.unlink()
        self._lock.release()


@contextmanager
def held(paths: Iterable[Path], what: str, purpose: str, *, settles: bool = True) -> Iterator[bool]:
    """Hold several locks on one object; yield whether the last holder of any of them ended without releasing it.

    The locks stay abandoned for the next holder if the block raises or `settles` is false, since nothing was repaired.
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
    """Return whether any process holds the lock of that name; a lock that cannot be tested counts as held."""
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
    # Every user may open it, so that a run of another user finds it held. A soft lock would outlive a killed process.
    return FileLock(path, mode=0o666, thread_local=False, fallback_to_soft=False)


def _note(path: Path) -> Path:
    return path.with_suffix(".json")


def _replace(path: Path, text: str) -> None:
    """Replace the path, whatever it is, by a new file."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}.tmp")  # `recover` removes files of that name after a crash
    with suppress(FileNotFoundError):
        fresh.unlink()
    with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644), "w", encoding="utf-8") as file:
        file.write(text)
    fresh.chmod(0o644)  # regardless of the umask: other users must be able to read the holder
    fresh.replace(path)


def _holder(path: Path) -> str:
    try:
        note = read_json(_note(path), "the lock's note")
        return f"process {note['pid']} ({note['purpose']}, since {note['since']})"
    except (UsageError, KeyError, TypeError):
        return "another process"
