"""The faults of a line on which a simulated gyro sends frames by itself: what becomes of one frame.

| kind                 | what becomes of the frame                          |
|----------------------|----------------------------------------------------|
| `frame_lost`         | it never comes                                     |
| `frame_cut`          | its second half never comes                        |
| `frame_bad_checksum` | one bit of its last bytes is the other way round   |
| `frame_junk_before`  | bytes that nobody sent stand before it             |
| `frame_junk_in`      | ... in its middle                                  |
| `frame_junk_after`   | ... behind it                                      |
| `frames_end`         | neither it nor anything after it comes             |

A frame reads as `frame 17`, counted from 0 over all streams. What is no frame, the answer to a command, passes as it
is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.simulated.faults.schedule import FaultLog, Fired, Schedule
from benchctl_instruments.simulated.faults.tables import FaultTable, Place

FrameKind = Literal[
    "frame_lost",
    "frame_cut",
    "frame_bad_checksum",
    "frame_junk_before",
    "frame_junk_in",
    "frame_junk_after",
    "frames_end",
]


class FrameFault(FaultTable):
    """A fault that befalls a frame."""

    places: ClassVar[tuple[Place, ...]] = ("gyro",)

    kind: FrameKind


JUNK = bytes.fromhex("ff 00 5a 81")
CHECKSUM_BYTES = 4


class FrameFaults:
    """To be set as `PushLine.disturb`.

    Parameters
    ----------
    frame_bytes
        Length of a frame.
    faults
        What becomes of which frames; of those that are due at one frame, the first in order has it.
    batch_s
        The bench times of the frames that are being sent, shape (n,).
    log
        Where to note what has happened.
    """

    def __init__(
        self, frame_bytes: int, faults: Sequence[FrameFault], *, batch_s: Callable[[], FloatArray], log: FaultLog
    ) -> None:
        self._frame_bytes = frame_bytes
        self._faults = [(fault, Schedule(fault.when)) for fault in faults]
        self._batch_s = batch_s
        self._log = log
        self._frames = 0
        self._silent = False

    def __call__(self, data: bytes) -> bytes:
        """What the client gets of what was sent."""
        if not data or len(data) % self._frame_bytes:
            return data
        size = self._frame_bytes
        frames = [data[first : first + size] for first in range(0, len(data), size)]
        return b"".join(map(self._befallen, frames, self._batch_s().tolist()))

    def _befallen(self, frame: bytes, now_s: float) -> bytes:
        operation = f"frame {self._frames}"
        self._frames += 1
        if self._silent:
            return b""
        due = [fault for fault, schedule in self._faults if schedule.fires(operation, now_s)]
        if not due:
            return frame
        kind = due[0].kind
        self._log.note(Fired(bench_s=now_s, where="gyro", kind=kind, operation=operation))
        self._silent = kind == "frames_end"
        middle = len(frame) // 2
        match kind:
            case "frame_lost" | "frames_end":
                return b""
            case "frame_cut":
                return frame[:middle]
            case "frame_bad_checksum":
                place = len(frame) - CHECKSUM_BYTES
                return frame[:place] + bytes([frame[place] ^ 0x10]) + frame[place + 1 :]
            case "frame_junk_before":
                return JUNK + frame
            case "frame_junk_in":
                return frame[:middle] + JUNK + frame[middle:]
            case "frame_junk_after":
                return frame + JUNK
