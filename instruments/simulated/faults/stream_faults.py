"""The faults of streams: packets of a digitizer's stream, frames of a digital gyro.

An operation of a digitizer's stream is a packet, `packet 17`, at the instant of its first scan. Packets are counted
from 0 in each stream. A T7's numbers may begin anywhere, so the loss of packet 0 cannot be detected.

A digital gyro sends frames spontaneously; these are the faults of one frame:

| kind                 | effect on the frame                                |
|----------------------|----------------------------------------------------|
| `frame_lost`         | it is lost                                         |
| `frame_cut`          | its second half is lost                            |
| `frame_bad_checksum` | one bit of its last bytes is inverted              |
| `frame_junk_before`  | junk bytes precede it                              |
| `frame_junk_in`      | ... in its middle                                  |
| `frame_junk_after`   | ... after it                                       |
| `frames_end`         | it and all later frames are lost                   |

The text of a frame is `frame 17`, counted from 0 over all streams. Other data, such as the answer to a command, are
passed unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.simulated.faults.schedule import LASTS, FaultTable, Fired, PendingFaults, Place, Positive


class StreamFault(FaultTable):
    """A fault of a packet of the stream."""

    places: ClassVar[tuple[Place, ...]] = ("digitizer_stream",)


class StreamGap(StreamFault):
    """Packets are lost: this one and the following ones, `packets` in total."""

    kind: Literal["stream_gap"] = "stream_gap"
    packets: int = Field(default=1, ge=1, description="How many are lost.")


class Overrun(StreamFault):
    """Before this packet the instrument's buffer is full: it skips `scans` scans, reports this, and continues."""

    kind: Literal["overrun"] = "overrun"
    scans: int = Field(default=50, ge=1, le=0xFFFF, description="How many are skipped.")


class StreamCut(StreamFault):
    """The connection of the stream ends in the middle of this packet; the stream itself continues."""

    kind: Literal["stream_cut"] = "stream_cut"


class StreamJunk(StreamFault):
    """Bytes that are no packet precede this packet."""

    kind: Literal["stream_junk"] = "stream_junk"


class StreamStalls(StreamFault):
    """Nothing is sent for `for_s` of wall time; meanwhile the instrument's buffer fills."""

    kind: Literal["stream_stalls"] = "stream_stalls"
    for_s: Annotated[Positive, LASTS] = 0.5


class StreamEnds(StreamFault):
    """The stream ends by itself without any report."""

    kind: Literal["stream_ends"] = "stream_ends"


AnyStreamFault = StreamGap | Overrun | StreamCut | StreamJunk | StreamStalls | StreamEnds


JUNK = bytes.fromhex("ff 00 5a ff 00 5a ff 00 5a ff 00 5a ff 00 5a ff")


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
    """A fault of a frame."""

    places: ClassVar[tuple[Place, ...]] = ("gyro",)

    kind: FrameKind


FRAME_JUNK = bytes.fromhex("ff 00 5a 81")
CHECKSUM_BYTES = 4


class FrameFaults:
    """A function with faults, to be assigned to `PushLine.disturb`.

    Parameters
    ----------
    frame_bytes
        Length of a frame.
    faults
        The faults of frames; if several are due at one frame, the first one happens.
    batch_s
        The bench times of the frames that are being sent, shape (n,).
    log
        The log of faults that have happened.
    """

    def __init__(
        self, frame_bytes: int, faults: Sequence[FrameFault], *, batch_s: Callable[[], FloatArray], log: list[Fired]
    ) -> None:
        self._frame_bytes = frame_bytes
        self._faults = PendingFaults("gyro", faults, log)
        self._batch_s = batch_s
        self._frames = 0
        self._silent = False

    def __call__(self, data: bytes) -> bytes:
        """Return the bytes that the client receives for the bytes sent."""
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
        fault = self._faults.due(operation, now_s)
        if fault is None:
            return frame
        kind = fault.kind
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
                return FRAME_JUNK + frame
            case "frame_junk_in":
                return frame[:middle] + FRAME_JUNK + frame[middle:]
            case "frame_junk_after":
                return frame + FRAME_JUNK
