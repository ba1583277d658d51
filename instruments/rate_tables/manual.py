"""A rate table without a wire: an operator sets each rate, and the digitizer's encoder measures it.

A commanded rate is a request to the operator, so only nominal; all readings come from the encoder. A limit, an error or
the guard of a run can also only request a stop: only the operator can stop this table. It has no angles and no
sinusoids. Not tried on hardware.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import ClassVar

from benchctl_instruments.errors import BenchError, InstrumentError, UsageError
from benchctl_instruments.interfaces import (
    Clock,
    Digitizer,
    Identity,
    Instrument,
    ScanBlock,
    SingleScan,
    StreamStart,
    TableLimits,
    TableReading,
    TableState,
)
from benchctl_instruments.rate_tables.constant_rate_table import LEAST, KeptLimits

NAME = "rate_table"
ONLY_THE_OPERATOR = f"{NAME}: it is operated manually: only the operator can stop it"
WARNING = f"{ONLY_THE_OPERATOR}; after an error or Ctrl-C a run and its guard only request a stop: stay within reach"

Operator = Callable[[float], None]
"""Requests a rate [deg/s], positive counter-clockwise from above, or a stop (0); returns when that was answered."""

_REST_DPS = 0.05
_HALF_WRAP = 1 << 31  # a digitizer's single count may have 32 bits
_PAUSE_CHUNKS = 0.2  # between two counts that give the first rate
_OLD_CHUNKS = 4.0  # an earlier count gives no present rate


class WatchedDigitizer(Instrument):
    """A `Digitizer` that derives the table's rate from each encoder count that is read from it.

    A rate is the mean over `clock.chunk_s` or longer: single counts are timed by the host. One count is no motion,
    because an edge of the encoder may lie at its reading head.

    Parameters
    ----------
    digitizer
        The digitizer; this class opens and closes it.
    clock
        Bench time.
    degrees_per_count
        Angle of one count, positive if the count rises counter-clockwise from above.
    """

    def __init__(self, digitizer: Digitizer, *, clock: Clock, degrees_per_count: float) -> None:
        self._digitizer, self._clock, self._degrees_per_count = digitizer, clock, degrees_per_count
        self._counts: deque[tuple[float, int]] = deque()  # time [s], count
        self._rate_hz: float | None = None  # of the running stream
        self._motion = TableReading(angle_deg=math.nan, rate_dps=math.nan, acceleration_dps2=math.nan)

    def open(self) -> None:
        """Open the digitizer."""
        self._digitizer.open()

    def close(self) -> None:
        """Close the digitizer."""
        self._digitizer.close()

    def identify(self) -> Identity:
        """Return the digitizer's identity."""
        return self._digitizer.identify()

    def read_once(self) -> SingleScan:
        """See `Digitizer`."""
        asked_s = self._clock.now()
        scan = self._digitizer.read_once()
        self._see(0.5 * (asked_s + self._clock.now()), scan.encoder_count)
        return scan

    def start_stream(self, rate_hz: float) -> StreamStart:
        """See `Digitizer`."""
        start = self._digitizer.start_stream(rate_hz)
        self._counts.clear()
        self._rate_hz = start.rate_hz
        return start

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        """See `Digitizer`."""
        block = self._digitizer.read_stream(scans, timeout_s)
        if self._rate_hz is not None and len(block.encoder_count):
            for index in (0, len(block.encoder_count) - 1):
                self._see((block.first_index + index) / self._rate_hz, int(block.encoder_count[index]))
        return block

    def stop_stream(self) -> None:
        """See `Digitizer`."""
        self._digitizer.stop_stream()
        self._counts.clear()
        self._rate_hz = None

    def end_stream(self) -> None:
        """Stop the stream if one runs, so that `motion` no longer depends on a reader of the stream."""
        if self._rate_hz is not None:
            self.stop_stream()

    def motion(self) -> TableReading:
        """Return the present motion; while a stream runs, that of the scans that were read last. NaN: not known."""
        if self._rate_hz is None:
            self.read_once()
            if len(self._counts) < 2:
                self._clock.sleep(_PAUSE_CHUNKS * self._clock.chunk_s)
                self.read_once()
        return self._motion

    def _see(self, time_s: float, count: int) -> None:
        counts, chunk_s = self._counts, self._clock.chunk_s
        if counts and time_s - counts[-1][0] > _OLD_CHUNKS * chunk_s:
            counts.clear()
        counts.append((time_s, count))
        while len(counts) > 2 and time_s - counts[1][0] >= chunk_s:
            counts.popleft()
        first_s, first = counts[0]
        if time_s <= first_s:
            return
        moved = (count - first + _HALF_WRAP) % (2 * _HALF_WRAP) - _HALF_WRAP
        self._motion = TableReading(
            angle_deg=count * self._degrees_per_count % 360.0,
            rate_dps=moved * self._degrees_per_count / (time_s - first_s) if abs(moved) > 1 else 0.0,
            acceleration_dps2=math.nan,
        )


def _nobody(rate_dps: float) -> None:
    raise InstrumentError(f"{NAME}: commanded {rate_dps:g} deg/s without an operator; set `operator` first")


class ManualTable(Instrument):
    """A `benchctl_instruments.interfaces.RateTable` whose commands go to `operator`.

    Parameters
    ----------
    address
        Not used: there is no wire.
    encoder
        The digitizer that samples the table's encoder.
    """

    oscillates: ClassVar[bool] = False

    def __init__(self, address: str | None = None, *, clock: Clock, encoder: WatchedDigitizer) -> None:
        self.operator: Operator = _nobody
        self._encoder = encoder
        self._limits = KeptLimits(NAME)

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing; the table continues its motion."""

    def identify(self) -> Identity:
        """Return the model."""
        return Identity(model="manual: set by an operator, measured by the encoder")

    def set_limits(self, limits: TableLimits) -> None:
        """Store the limit on the rate; nothing limits the acceleration."""
        self._limits.keep(limits)

    def enable(self) -> None:
        """Do nothing: there is no servo."""

    def disable(self) -> None:
        """Do nothing: there is no servo."""

    def go_to_rate(self, rate_dps: float) -> None:
        """Have the operator set a constant rate; returns when that was answered."""
        self._limits.check_rate(rate_dps)
        if abs(rate_dps) < LEAST:
            self.stop()
        else:
            self.operator(rate_dps)

    def go_to_angle(self, angle_deg: float) -> None:
        """Always raise `UsageError`."""
        raise UsageError(f"{NAME}: commanded an angle of {angle_deg:g} deg; a manual table has only rates")

    def oscillate(self, amplitude_dps: float, frequency_hz: float) -> None:
        """Always raise `UsageError`."""
        raise UsageError(
            f"{NAME}: commanded an oscillation; a manual table has only constant rates: take"
            " rate_sweep, temperature_sweep or static"
        )

    def stop(self) -> None:
        """Have the operator stop the table, unless the encoder shows it at rest; ends a running stream."""
        try:
            self._encoder.end_stream()
            moves = self.state() is TableState.MOVING
        except BenchError:
            moves = True  # it may move
        if moves:
            self.operator(0.0)

    def read(self) -> TableReading:
        """Return angle and rate by the encoder; the acceleration is NaN."""
        return self._encoder.motion()

    def state(self) -> TableState:
        """Return AT_REST or MOVING; MOVING also if the encoder cannot be read."""
        try:
            at_rest = abs(self.read().rate_dps) <= _REST_DPS
        except BenchError:
            at_rest = False
        return TableState.AT_REST if at_rest else TableState.MOVING


Driver = ManualTable
