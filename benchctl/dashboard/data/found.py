"""Where campaigns lie below a folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchctl.confined import walk
from benchctl.dashboard.data.kinds import is_open_recording
from benchctl.recordings.schema import CAMPAIGN, FINISHED_SUFFIX, JOURNAL, RECORDING, STEPS, UNREADABLE

_MOST_FOLDERS = 1 << 16


def campaigns_below(root: Path) -> Iterator[Path]:
    """The folders and files of campaigns and recordings anywhere below a folder, itself included.

    Of a campaign's folder that is the folder, and beside it any other recording there. Hidden folders are left out,
    and so are links: what they name inside the folder is found without them, and the rest is outside.
    """
    for count, (here, folders, names) in enumerate(walk(root)):
        if count == _MOST_FOLDERS:
            return
        begun = STEPS in folders and JOURNAL in names
        is_campaign = begun or CAMPAIGN in names or RECORDING in names
        inner = {STEPS, UNREADABLE} if is_campaign else set()
        folders[:] = sorted(name for name in folders if not name.startswith(".") and name not in inner)
        if (is_campaign and not (here / RECORDING).is_symlink()) or is_open_recording(here):
            yield here
        for name in sorted(names):
            path = here / name
            ours = name.endswith(FINISHED_SUFFIX) and name not in (CAMPAIGN, RECORDING) and not name.startswith(".")
            if ours and path.is_file() and not path.is_symlink():
                yield path
