"""A digitizer's stream that outlives its own end: where it falls silent it is started anew, its scans go on counting.

A driver connects again by itself, and what it lost then is a gap. Beyond that nobody can say whether a stream goes on,
so after a question without an answer this is done at the next one:

| what came meanwhile                        | what is done                                                          |
|--------------------------------------------|-----------------------------------------------------------------------|
| scans of the same stream                   | they are taken: nothing is missing, or what their numbers say         |
| nothing, or it never brought a single scan | it is stopped and started anew: what lies between the two is a gap    |

The instants of the new stream are those that the digitizer states for it, on its own counter: scans before and behind
the gap share one clock, if not one grid. How often to ask is the caller's affair.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TypeVar

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import LinkError
from benchctl_instruments.interfaces import Clock, Digitizer, ScanBlock
from benchctl_instruments.links.recovered import note_recovered

Instant = TypeVar("Instant", float, FloatArray)


class LastingStream:
    """The stream of a step, which begins at once.

    Parameters
    ----------
    digitizer
        No stream runs on it yet.
    clock
        Bench time: a stream that was started anew needs some of it for its first scans.
    rate_hz
        Scans a second.
    patience_s
        How long to wait for scans, wall time; twice, before a stream is started anew.
    first_scans_s
        Bench time in which the first scans of a stream arrive.
    beat
        Called between the parts of a recovery, each of which may take as long as a time-out.
    """

    def __init__(
        self,
        digitizer: Digitizer,
        clock: Clock,
        *,
        rate_hz: float,
        patience_s: float,
        first_scans_s: float,
        beat: Callable[[], None],
    ) -> None:
        self._digitizer, self._clock, self._beat = digitizer, clock, beat
        self._wanted_hz, self._patience_s, self._first_scans_s = rate_hz, patience_s, first_scans_s
        start = digitizer.start_stream(rate_hz)
        self.rate_hz = start.rate_hz
        self._first_s, self._first_index = start.start_s, 0  # of the present stream's first scan
        self._next_index = 0
        self._brought_some = False  # the present stream
        self._failure: LinkError | None = None  # why the last question had no answer

    def instant_s(self, index: Instant) -> Instant:
        """When scans were taken, on the digitizer's counter; for those of the latest block and what follows it."""
        return self._first_s + (index - self._first_index) / self.rate_hz

    def read(self, scans: int) -> ScanBlock:
        """At least `scans` scans; fewer before a gap, or where they come late or from a stream that was started anew.

        Raises `LinkError` where none came: then it may be asked again, as long as the caller has patience.
        """
        try:
            block = self._read(scans)
        except LinkError as err:
            self._failure = err
            raise
        self._brought_some = True
        self._next_index = self._first_index + block.first_index + len(block.gyro_v)
        return replace(block, first_index=self._first_index + block.first_index)

    def _read(self, scans: int) -> ScanBlock:
        failure = self._failure
        if failure is None:
            return self._digitizer.read_stream(scans, timeout_s=self._patience_s)
        if self._brought_some:
            with suppress(LinkError):
                late = self._digitizer.read_stream(1, timeout_s=self._patience_s)
                if len(late.gyro_v) >= scans:
                    self._failure = None
                return late
        self._start_anew()
        block = self._digitizer.read_stream(1, timeout_s=self._patience_s)
        self._failure = None
        note_recovered(str(failure), "its stream was started anew, what is missing is a gap")
        return block

    def _start_anew(self) -> None:
        self._brought_some = False  # what still waits in the digitizer is discarded
        self._beat()
        self._digitizer.stop_stream()
        self._beat()
        start = self._digitizer.start_stream(self._wanted_hz)
        passed = round((start.start_s - self._first_s) * self.rate_hz)
        self._first_index = max(self._next_index + 1, self._first_index + passed)  # its grid is another: never no gap
        self._first_s = start.start_s
        self._beat()
        self._clock.sleep(self._first_scans_s)
