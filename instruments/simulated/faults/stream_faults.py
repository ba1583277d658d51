"""The faults of a stream while it is sent: asked for once a packet, in order, over all streams of the instrument."""

from __future__ import annotations

from collections.abc import Sequence

from benchctl_instruments.simulated.faults.log import FaultLog, Fired
from benchctl_instruments.simulated.faults.schedule import Schedule
from benchctl_instruments.simulated.faults.stream_kinds import StreamFault

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
