"""How a campaign stands: it runs, it died, or as its recording says it ended."""

from __future__ import annotations

from pathlib import Path

from benchctl.dashboard.data.contents import Contents
from benchctl.locks import is_held
from benchctl.recordings.schema import LOCK

RUNNING, DIED = "running", "died"
_ENDS = ("complete", "interrupted", "aborted", "imported", "simulated")


def status_of(contents: Contents) -> str:
    """`running`, `died` (not closed, and nobody holds its lock), or the status that its recording states."""
    if not contents.finished:
        return RUNNING if is_held(contents.path / LOCK) else DIED
    # a closed file that says anything else, or that it is being written, was taken away from the rest, or changed
    return contents.meta.status if contents.meta.status in _ENDS else DIED


def died_says(path: Path) -> str:
    """What to do about a campaign that died."""
    resume = f"benchctl run PROCEDURE --bench BENCH --resume {path}"
    return f"its program died: benchctl recover {path} closes it, {resume} goes on with it"
