"""The faults of a digitizer's stream: an operation is a packet, `packet 17`, at the instant of its first scan.

Packets are counted from 0 in each stream. A T7's may begin with any number, so nobody can tell that packet 0 was lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from benchctl_instruments.simulated.faults.schedule import FaultLog, Fired, Schedule
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


JUNK = bytes.fromhex("ff 00 5a ff 00 5a ff 00 5a ff 00 5a ff 00 5a ff")


class StreamFaults:
    """What befalls the packets of a stream; of several faults that are due the first one happens.

    Parameters
    ----------
    where
        The link's name, as the log states it.
    faults
        In the order in which they are looked at; every one counts every packet.
    log
        Where to note what has happened.
    """

    def __init__(self, where: str, faults: Sequence[StreamFault], log: FaultLog) -> None:
        self._where = where
        self._log = log
        self._faults = [(fault, Schedule(fault.when)) for fault in faults]

    def due(self, packet: int, instant_s: float) -> StreamFault | None:
        """The fault that befalls a packet, by its number in the stream and the bench time of its first scan."""
        operation = f"packet {packet}"
        due = [fault for fault, schedule in self._faults if schedule.fires(operation, instant_s)]
        if not due:
            return None
        self._log.note(Fired(bench_s=instant_s, where=self._where, kind=due[0].kind, operation=operation))
        return due[0]
