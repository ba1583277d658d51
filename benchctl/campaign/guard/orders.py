"""What runner and guard send each other through two pipes, a line a word, and how the guard listens.

```
runner -> guard   {"runner": 4711, "journal": "…", …}   the orders, before anything else
                  beat 60.0                             all is well, and the next word comes within 60 s of wall time
                  done                                  the bench is at rest and has been read back
guard -> runner   heard                                 to each beat
```

The first beat arms the guard: before it nothing has moved. A pipe that ends before "done" means that the runner died;
the kernel ends it at once, whatever killed the runner.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from io import RawIOBase
from pathlib import Path
from typing import Any, Self

BEAT, DONE, HEARD = "beat", "done", "heard"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reached:
    """How an instrument is reached: its driver's model, address and further keywords; the files of its locks.

    `profile` is the text of the chamber profile that `model` names: its file may be gone when it is needed.
    """

    model: str
    address: str
    options: Mapping[str, Any]
    locks: list[str]
    profile: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Orders:
    """What the guard must know to bring the bench to rest by itself.

    `runner` is the process to watch, `journal` the campaign's; the table should rest within `rest_within_s` of bench
    time, and the chamber go to `safe_c`.
    """

    runner: int
    journal: Path
    time_factor: float
    rest_within_s: float
    safe_c: float
    rate_table: Reached
    chamber: Reached

    def as_line(self) -> str:
        """One line of JSON; a date among the options of a driver goes as text."""
        return json.dumps({**asdict(self), "journal": str(self.journal)}, default=str)

    @classmethod
    def from_line(cls, line: str) -> Self:
        """The reverse of `as_line`."""
        said = json.loads(line)
        made = {
            "journal": Path(said["journal"]),
            "rate_table": Reached(**said["rate_table"]),
            "chamber": Reached(**said["chamber"]),
        }
        return cls(**{**said, **made})


SLICE_S = 0.25
"""Silence is counted in slices: time in which the whole machine stood still is nobody's silence."""


class Ending(Enum):
    """How the watch ended."""

    UNARMED = "the runner ended before anything moved"
    DONE = "the runner brought the bench to rest"
    ENDED = "the runner ended without saying that the bench is at rest"
    HANGS = "the runner hangs"


class PipeLines:
    """The lines of a pipe, each within a time; a thread of its own reads, since not every system can wait on a pipe."""

    def __init__(self, pipe: RawIOBase) -> None:
        self._pipe = pipe
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, name="pipe from the runner", daemon=True).start()

    def next(self, timeout_s: float | None) -> str | None:
        """The next line; "" at the end of the pipe, None where none comes within `timeout_s` of wall time."""
        try:
            return self._lines.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def end(self, timeout_s: float) -> bool:
        """Whether the pipe ends within `timeout_s` of wall time."""
        until_s = time.monotonic() + timeout_s
        while (left_s := until_s - time.monotonic()) > 0:
            if self.next(left_s) == "":
                return True
        return False

    def _read(self) -> None:
        with self._pipe:
            while line := self._pipe.readline():
                self._lines.put(line.decode("utf-8"))
        self._lines.put("")


def watch(lines: PipeLines, answer: Callable[[], None]) -> Ending:
    """Listen until the guard must act or may go; `answer` is called for each beat."""
    allowed_s: float | None = None
    silent_s = 0.0
    while True:
        began_s = time.monotonic()
        line = lines.next(SLICE_S)
        if line is None:
            silent_s += min(time.monotonic() - began_s, 2 * SLICE_S)
            if allowed_s is not None and silent_s > allowed_s:
                return Ending.HANGS
            continue
        if not line:
            return Ending.UNARMED if allowed_s is None else Ending.ENDED
        if line.strip() == DONE:
            return Ending.DONE
        allowed_s, silent_s = float(line.split()[1]), 0.0
        answer()
