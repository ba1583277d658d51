"""A process that closes or reopens a campaign until it is killed: `python -m … FOLDER recover` or `… FOLDER reopen`.

It prints `begins` once all is imported, and `done` at the end.
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchctl.recordings.campaign_folder import campaign_lock
from benchctl.recordings.recover import recover, reopen


def main(folder: Path, how: str) -> None:
    _say("begins")
    if how == "recover":
        recover(folder)
    else:
        lock = campaign_lock(folder)
        lock.acquire("a test")
        reopen(folder, planned=12, lock=lock)
        lock.release()
    _say("done")


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
