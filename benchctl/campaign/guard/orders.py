"""What runner and guard say to each other: two pipes, a line a word.

```
runner -> guard   {"runner": 4711, "journal": "…", …}   the orders, before anything else
                  beat 60.0                             all is well, and the next word comes within 60 s of wall time
                  done                                  the bench is at rest and has been read back
guard -> runner   heard                                 to each beat
```

The first beat arms the guard: before it nothing has moved. A pipe that ends before "done" says that the runner died;
the kernel ends it at once, whatever killed the runner.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
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
