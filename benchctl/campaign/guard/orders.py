"""Messages between runner and guard through two pipes, one line each, and how the guard listens.

```
runner -> guard   {"runner": 4711, "journal": "…", …}   the orders, before anything else
                  beat 60.0                             all is well; the next line follows within 60 s of wall time
                  done                                  the bench is at rest and has been read back
guard -> runner   heard                                 answer to each beat
```

The first beat arms the guard: before it nothing has moved. A pipe that ends before "done" means that the runner died;
the kernel closes the pipe immediately, whatever killed the runner.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
from io import RawIOBase
from pathlib import Path
from typing import Any, Self

BEAT, DONE, HEARD = "beat", "done", "heard"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reached:
    """How to reach an instrument: its driver's model, address and further keywords, and its lock files.

    `profile` is the text of the chamber profile that `model` names, because its file may be gone when it is needed. A
    manual rate table has no address.
    """

    model: str
    address: str
    options: Mapping[str, Any]
    locks: list[str]
    profile: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Orders:
    """What the guard needs in order to bring the bench to rest by itself.

    `runner` is the process to watch, `journal` the campaign's journal. The table should be at rest within
    `rest_within_s` of bench time; the chamber's set point becomes `safe_c`. `notify` are the URLs that get a message
    about it, with their secrets: orders go through the pipe only.
    """

    runner: int
    journal: Path
    time_factor: float
    rest_within_s: float
    safe_c: float
    rate_table: Reached
    chamber: Reached
    notify: list[str] = field(default_factory=list)

    @property
    def by_hand(self) -> bool:
        """Whether only an operator can stop the table."""
        return not self.rate_table.address

    def as_line(self) -> str:
        """Return the orders as one line of JSON; a date in a driver's options is written as text."""
        return json.dumps({**asdict(self), "journal": str(self.journal)}, default=str)

    @classmethod
    def from_line(cls, line: str) -> Self:
        """Read orders from a line that `as_line` wrote."""
        data = json.loads(line)
        made = {
            "journal": Path(data["journal"]),
            "rate_table": Reached(**data["rate_table"]),
            "chamber": Reached(**data["chamber"]),
        }
        return cls(**{**data, **made})


SLICE_S = 0.25
"""Silence is counted in slices, so that time in which the machine itself was suspended does not count."""


class Ending(Enum):
    """How the watch ended."""

    UNARMED = "the runner ended before anything moved"
    DONE = "the runner brought the bench to rest"
    ENDED = "the runner ended without saying that the bench is at rest"
    HANGS = "the runner hangs"


class PipeLines:
    """The lines of a pipe, read with a time limit; a thread reads, because not every system can wait on a pipe."""

    def __init__(self, pipe: RawIOBase) -> None:
        self._pipe = pipe
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, name="pipe from the runner", daemon=True).start()

    def next(self, timeout_s: float | None) -> str | None:
        """Return the next line; "" at the end of the pipe, None if there is none within `timeout_s` of wall time."""
        try:
            return self._lines.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def end(self, timeout_s: float) -> bool:
        """Return whether the pipe ends within `timeout_s` of wall time."""
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
    """Listen until the guard must act or may end; `answer` is called for each beat."""
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
