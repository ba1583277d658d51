"""The faults of a line on which a simulated gyro sends frames by itself: what becomes of one frame.

| kind           | what becomes of the frame                                                       |
|----------------|---------------------------------------------------------------------------------|
| `lost`         | it never comes                                                                  |
| `cut`          | its second half never comes                                                     |
| `bad_checksum` | one bit of its last bytes is the other way round                                |
| `junk_before`  | bytes that nobody sent stand before it                                          |
| `junk_in`      | ... in its middle                                                               |
| `junk_after`   | ... behind it                                                                   |
| `silence`      | neither it nor anything after it comes                                          |

A frame reads as `frame 17`, counted from 0 over all streams. What is no frame, the answer to a command, passes as it
is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from instruments.simulated.faults.log import FaultLog, Fired
from instruments.simulated.faults.schedule import Schedule, When

FrameKind = Literal["lost", "cut", "bad_checksum", "junk_before", "junk_in", "junk_after", "silence"]
JUNK = bytes.fromhex("ff 00 5a 81")
CHECKSUM_BYTES = 4


class FrameFaults:
    """To be set as `PushLine.disturb`.

    Parameters
    ----------
    frame_bytes
        Length of a frame.
    kind
        What becomes of it.
    when
        Which frames.
    now
        Bench time.
    log
        Where to note what has happened.
    """

    def __init__(
        self, frame_bytes: int, kind: FrameKind, when: When, *, now: Callable[[], float], log: FaultLog
    ) -> None:
        self._frame_bytes = frame_bytes
        self._kind = kind
        self._schedule = Schedule(when)
        self._now = now
        self._log = log
        self._frames = 0
        self._silent = False

    def __call__(self, data: bytes) -> bytes:
        """What the client gets of what was sent."""
        if not data or len(data) % self._frame_bytes:
            return data
        size = self._frame_bytes
        return b"".join(self._befallen(data[first : first + size]) for first in range(0, len(data), size))

    def _befallen(self, frame: bytes) -> bytes:
        operation, now_s = f"frame {self._frames}", self._now()
        self._frames += 1
        if self._silent:
            return b""
        if not self._schedule.fires(operation, now_s):
            return frame
        self._log.note(Fired(bench_s=now_s, where="gyro", kind=self._kind, operation=operation))
        self._silent = self._kind == "silence"
        middle = len(frame) // 2
        match self._kind:
            case "lost" | "silence":
                return b""
            case "cut":
                return frame[:middle]
            case "bad_checksum":
                place = len(frame) - CHECKSUM_BYTES
                return frame[:place] + bytes([frame[place] ^ 0x10]) + frame[place + 1 :]
            case "junk_before":
                return JUNK + frame
            case "junk_in":
                return frame[:middle] + JUNK + frame[middle:]
            case "junk_after":
                return frame + JUNK
