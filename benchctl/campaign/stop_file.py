"""A wish to stop a run, left as a file in its campaign's folder by a process that sends no signals: the live page.

```
{"who": "operator", "asked_utc": "2026-11-20T18:00:00+00:00"}
```

Whoever asks needs no more than the folder, and the run looks for the file between two looks at its instruments. It
counts only for the run that holds the campaign's lock, and only where it was written since that took it: what an
earlier run left behind stops nobody. It is gone once the campaign is closed, and no manifest names it.
"""

from __future__ import annotations

import json
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from benchctl.atomic import whole_file
from benchctl.campaign.stop import StopRequest
from benchctl.documents import read_json
from benchctl.limits import cut
from benchctl.locks import is_held
from benchctl.recordings.schema import LOCK, STOP
from benchctl_instruments.errors import UsageError

_LONGEST_WHO = 60


class NotRunningError(UsageError):
    """Nobody writes the campaign: there is no run to stop."""


def ask_by_file(folder: Path, who: str) -> None:
    """Ask the run that writes a campaign's folder to stop; `who` asks, in a word or two.

    Raises
    ------
    NotRunningError
        Where no run holds the campaign's lock, or it ended meanwhile.
    UsageError
        Where the folder may not be written to.
    """
    _require_run(folder)
    with whole_file(folder / STOP) as temporary:
        temporary.write_text(json.dumps({"who": who, "asked_utc": datetime.now(UTC).isoformat(timespec="seconds")}))
    try:
        _require_run(folder)
    except NotRunningError:
        forget_stop(folder)
        raise


def is_asked(folder: Path) -> bool:
    """Whether a wish to stop lies in a campaign's folder that its run has not heeded yet."""
    return (folder / STOP).exists()


def heed_file(stop: StopRequest, folder: Path) -> None:
    """Let a run's `stop` also heed what is asked in its campaign's folder, which need not be there yet."""
    path = folder / STOP

    def asked() -> str:
        try:
            path.stat()
        except OSError:
            return ""
        return f"the live page ({_who(path)})"

    stop.watch(asked)


def forget_stop(folder: Path) -> None:
    """Remove a wish to stop; who calls this has the campaign's lock, or has just closed the campaign."""
    with suppress(OSError):
        (folder / STOP).unlink()


def forget_stale_stop(folder: Path) -> None:
    """Remove a wish to stop that an earlier run has left; one that came since the lock was taken stays.

    Who calls this has the campaign's lock.
    """
    with suppress(OSError):
        if (folder / STOP).stat().st_mtime_ns < (folder / LOCK).with_suffix(".json").stat().st_mtime_ns:
            forget_stop(folder)


def _require_run(folder: Path) -> None:
    if not is_held(folder / LOCK):
        raise NotRunningError(f"campaign {folder.name}: nobody runs it any more; there is nothing to stop")


def _who(path: Path) -> str:
    """Who asks, as far as the file says so: a stop is heeded whatever is in it."""
    try:
        who = read_json(path, "stop request")["who"]
    except (UsageError, KeyError, TypeError):
        return "somebody"
    return cut("".join(letter for letter in str(who) if letter.isprintable()), _LONGEST_WHO) or "somebody"
