"""The faults of a digitizer's stream: an operation is a packet, `packet 17`, at the instant of its first scan.

Packets are counted from 0 in each stream. A T7's may begin with any number, so nobody can tell that packet 0 was lost.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from benchctl_instruments.simulated.faults.tables import FaultTable, Place, Positive


class StreamFault(FaultTable):
    """A fault that befalls a packet of the stream."""

    places: ClassVar[tuple[Place, ...]] = ("digitizer_stream",)


class StreamGap(StreamFault):
    """Packets never come: that one, and so many after it that they are `packets` in all."""

    kind: Literal["stream_gap"] = "stream_gap"
    packets: int = Field(default=1, ge=1)


class Overrun(StreamFault):
    """Before this packet the instrument's buffer is full: it skips `scans` scans, says so, and goes on."""

    kind: Literal["overrun"] = "overrun"
    scans: int = Field(default=50, ge=1, le=0xFFFF)


class StreamCut(StreamFault):
    """The connection of the stream ends in the middle of this packet; the stream itself goes on."""

    kind: Literal["stream_cut"] = "stream_cut"


class StreamJunk(StreamFault):
    """Bytes that are no packet come before this packet."""

    kind: Literal["stream_junk"] = "stream_junk"


class StreamStalls(StreamFault):
    """Nothing is sent for `for_s` of wall time; the instrument's buffer fills meanwhile."""

    kind: Literal["stream_stalls"] = "stream_stalls"
    for_s: Positive = 0.5


class StreamEnds(StreamFault):
    """The stream ends by itself, and nothing says so."""

    kind: Literal["stream_ends"] = "stream_ends"


AnyStreamFault = StreamGap | Overrun | StreamCut | StreamJunk | StreamStalls | StreamEnds
