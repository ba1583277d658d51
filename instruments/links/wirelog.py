"""A log of the traffic on a link: a bounded, thread-safe ring buffer that every link writes and error messages quote.

A recovered fault of a link is logged by the logger `benchctl_instruments.links.recovered`. A campaign attaches a
handler and stores the records in its journal; without a handler nothing is printed.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Direction = Literal["sent", "received", "note"]

_MARKS: dict[Direction, str] = {"sent": ">", "received": "<", "note": "-"}


@dataclass(frozen=True, slots=True, kw_only=True)
class WireEntry:
    """One packet or one event on a link.

    `time_s` is seconds of wall time since the epoch; `length` is the packet's full length, of which `data` may hold
    only the beginning. The data of a note are its text.
    """

    time_s: float
    direction: Direction
    data: bytes
    length: int

    def __str__(self) -> str:
        stamp = time.strftime("%H:%M:%S", time.localtime(self.time_s)) + f".{int(self.time_s % 1 * 1000):03d}"
        shown = self.data.decode() if self.direction == "note" else repr(self.data)
        cut = f" and {self.length - len(self.data)} bytes more" if self.length > len(self.data) else ""
        return f"{stamp} {_MARKS[self.direction]} {shown}{cut}"


class WireLog:
    """The last `size` entries, each with at most `entry_bytes` bytes of its data.

    `sink` is called with every entry, in order, by the thread that wrote it; it must be fast and must not write to the
    same log.
    """

    def __init__(
        self, *, size: int = 64, entry_bytes: int = 256, sink: Callable[[WireEntry], None] | None = None
    ) -> None:
        self._entries: deque[tuple[float, Direction, bytes, int]] = deque(maxlen=size)
        self._entry_bytes = entry_bytes
        self._sink = sink
        self._lock = threading.Lock()

    def sent(self, data: bytes) -> None:
        """Log bytes sent to the instrument."""
        self._write("sent", data)

    def received(self, data: bytes) -> None:
        """Log bytes received from the instrument."""
        self._write("received", data)

    def note(self, text: str) -> None:
        """Log an event of the link itself."""
        self._write("note", text.encode())

    def last(self, count: int) -> list[WireEntry]:
        """Return at most the last `count` entries, oldest first."""
        with self._lock:
            found = list(self._entries)[-count:] if count > 0 else []
        return [_entry(*written) for written in found]

    def tail(self, count: int = 4) -> str:
        """Return the last entries in one line, for an error message."""
        return "; ".join(str(entry) for entry in self.last(count)) or "nothing yet"

    def _write(self, direction: Direction, data: bytes) -> None:
        kept = data if direction == "note" else bytes(data[: self._entry_bytes])
        written = (time.time(), direction, kept, len(data))  # converted to an entry on demand
        with self._lock:
            self._entries.append(written)
            if self._sink is not None:
                self._sink(_entry(*written))


def _entry(time_s: float, direction: Direction, data: bytes, length: int) -> WireEntry:
    return WireEntry(time_s=time_s, direction=direction, data=data, length=length)


logger = logging.getLogger("benchctl_instruments.links.recovered")
logger.addHandler(logging.NullHandler())  # without a handler Python would print the records


def note_recovered(failure: str, how: str = "asked again, it answered") -> None:
    """Log a fault and how it was recovered; `failure` names the instrument."""
    logger.warning("%s; %s", failure, how)
