"""Gathers the steps of a long campaign in a process of its own while it runs, so that little is left for its end.

The process looks into `steps/` by itself and adds each finished step to a file beside, whose name no reader takes for a
recording, and checks it there. Asked at the end, it says which steps are in it. Nothing depends on it: the files of the
steps stay what counts until `recording.h5` has its name. Where the process has died, hangs or was not needed, the end
takes as long as it did without it. It removes its file where nobody asks for it, and ends with the program that it was
started by; a file that it could not remove is removed by `benchctl recover` and `resume`, as any half of one.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

from benchctl.atomic import beside
from benchctl.own_process import own_process
from benchctl.recordings.combine import Begun, add, begin
from benchctl.recordings.gather import finished_steps
from benchctl_instruments.errors import UsageError

MANY = 32
"""Steps after which a campaign is long: to start the process costs as much as to gather so many."""

_GATHERED = "gathered.h5"
_ASK = b"what is there?"
_LOOKS_EVERY_S = 0.2
_ANSWERS_WITHIN_S = 60.0
"""How long the process may take for the steps that it is at."""


class Gathering:
    """The process, as the campaign's writer sees it; it is started once `step_over` was told of `MANY` steps."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._path = beside(folder / _GATHERED)
        self._process: subprocess.Popen[bytes] | None = None
        self._over = 0

    def step_over(self) -> None:
        """Take note of another finished step."""
        self._over += 1
        if self._over == MANY:
            with suppress(OSError):  # no room for a process: all is gathered at the end
                where = [str(path.absolute()) for path in (self._folder, self._path)]
                self._process = own_process(__name__, where, stderr=subprocess.DEVNULL)

    def begun(self) -> Begun | None:
        """End the process; the file that it leaves, which is the caller's to use or to remove. None: there is none."""
        said = self._end(_ASK)
        try:
            return Begun(self._path, tuple(json.loads(said)))
        except ValueError:
            self._remove()
            return None

    def end(self) -> None:
        """End the process and remove what it gathered."""
        self._end(b"")
        self._remove()

    def _end(self, word: bytes) -> bytes:
        process, self._process = self._process, None
        if process is None:
            return b""
        try:
            return process.communicate(word, timeout=_ANSWERS_WITHIN_S)[0]
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return b""

    def _remove(self) -> None:
        with suppress(OSError):  # `remove_leftovers` tries it again
            self._path.unlink(missing_ok=True)


def main(folder: Path, path: Path) -> None:
    """Gather in a file what is finished in a campaign's folder, until asked for it, or until nobody can ask any more.

    Prints the names of the files of the steps that are in it.
    """
    asked, word = threading.Event(), bytearray()

    def listen() -> None:
        word.extend(os.read(0, len(_ASK)))
        asked.set()

    threading.Thread(target=listen, daemon=True).start()
    files: list[str] = []
    try:
        begin(path)
        while not asked.wait(_LOOKS_EVERY_S):
            if more := [file for file in finished_steps(folder) if file.name not in files]:
                add(path, more)
                files += [file.name for file in more]
    finally:
        if word != _ASK:
            path.unlink(missing_ok=True)
    if word == _ASK:
        sys.stdout.write(json.dumps(files))
        sys.stdout.flush()


if __name__ == "__main__":
    with suppress(OSError, UsageError):  # whoever asks then meets the same, and says it
        main(Path(sys.argv[1]), Path(sys.argv[2]))
