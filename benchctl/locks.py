"""Locks between processes: one run a bench, one writer a campaign.

The system holds them, so that a process that was killed leaves none behind; a file that stays is only a name. Beside it
a note says who holds the lock, for whoever is refused.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from filelock import FileLock, Timeout

from benchctl.documents import read_json
from instruments.errors import UsageError, reason

_PATIENCE_S = 1.0
"""Whoever only looks whether a lock is held holds it for a moment."""


class Lock:
    """A lock on `what` (in words), by the name of a file; held from `acquire` to `release` or to the process' end."""

    def __init__(self, path: Path, what: str) -> None:
        self._path, self._what = path, what
        self._lock = _file_lock(path)

    def acquire(self, purpose: str) -> None:
        """Take the lock; `purpose` says what for.

        Raises `UsageError` where another process has it, naming that process, or where the file system has no locks.
        """
        try:
            self._lock.acquire(timeout=_PATIENCE_S)
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
            _note(self._path).write_text(json.dumps(note, ensure_ascii=False) + "\n", encoding="utf-8")

    def release(self) -> None:
        """Give the lock back and remove its files; safe to call twice."""
        if not self._lock.is_locked:
            return
        for file in (_note(self._path), self._path):  # while it is held: afterwards they may be another's
            with suppress(OSError):
                file.unlink()
        self._lock.release()


def is_held(path: Path) -> bool:
    """Whether any process holds the lock of that name; one who may not look takes it as held."""
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
    # A soft lock in place of a missing one would outlive a killed process.
    return FileLock(path, thread_local=False, fallback_to_soft=False)


def _note(path: Path) -> Path:
    return path.with_suffix(".json")


def _holder(path: Path) -> str:
    try:
        note = read_json(_note(path), "the lock's note")
        return f"process {note['pid']} ({note['purpose']}, since {note['since']})"
    except (UsageError, KeyError, TypeError):
        return "another process"
