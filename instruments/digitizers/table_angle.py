"""The angle of the rate table's own read-back, in place of the encoder of a digitizer that has no input for one."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from benchctl_instruments.interfaces import (
    Clock,
    Digitizer,
    Identity,
    Instrument,
    RateTable,
    ScanBlock,
    SingleScan,
    StreamStart,
)


class TableAngleDigitizer(Instrument):
    """A `Digitizer` whose encoder counts are the angles that the rate table's controller reports.

    The table is read after each block of scans; the angle of a scan is interpolated between two such readings, which
    the host's clock times to a few milliseconds. So it suits a table at rest or at a constant rate, and it is no check
    of the controller: both have the same source.

    Parameters
    ----------
    digitizer
        The digitizer, whose own counts are not used; this class opens and closes it.
    table
        The rate table, which is open whenever the digitizer is used.
    clock
        Bench time.
    degrees_per_count
        Angle of one count, to which the angles are rounded; positive if the count rises counter-clockwise from above.
    """

    def __init__(self, digitizer: Digitizer, table: RateTable, *, clock: Clock, degrees_per_count: float) -> None:
        self._digitizer, self._table, self._clock = digitizer, table, clock
        self._degrees_per_count = degrees_per_count
        self._rate_hz = self._began_s = 0.0  # of the running stream; by the clock
        self._looks: deque[tuple[float, float]] = deque()  # time [s], unwrapped angle [deg]
        self._rate_dps = 0.0  # at the last of them

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
        scan = self._digitizer.read_once()
        return replace(scan, encoder_count=round(self._table.read().angle_deg / self._degrees_per_count))

    def start_stream(self, rate_hz: float) -> StreamStart:
        """See `Digitizer`."""
        self._looks.clear()
        self._look()
        asked_s = self._clock.now()
        start = self._digitizer.start_stream(rate_hz)
        self._began_s, self._rate_hz = 0.5 * (asked_s + self._clock.now()), start.rate_hz
        return start

    def read_stream(self, scans: int, timeout_s: float) -> ScanBlock:
        """See `Digitizer`."""
        block = self._digitizer.read_stream(scans, timeout_s)
        self._look()
        times_s = self._began_s + (block.first_index + np.arange(len(block.gyro_v))) / self._rate_hz
        while len(self._looks) > 1 and self._looks[1][0] <= times_s[0]:
            self._looks.popleft()
        looks = np.array(self._looks)
        angles_deg = np.interp(times_s, looks[:, 0], looks[:, 1])
        return replace(block, encoder_count=np.round(angles_deg / self._degrees_per_count).astype(np.int64))

    def stop_stream(self) -> None:
        """See `Digitizer`."""
        self._digitizer.stop_stream()

    def _look(self) -> None:
        asked_s = self._clock.now()
        reading = self._table.read()
        time_s = 0.5 * (asked_s + self._clock.now())
        last_s, last_deg = self._looks[-1] if self._looks else (time_s, reading.angle_deg)
        expected_deg = last_deg + 0.5 * (self._rate_dps + reading.rate_dps) * (time_s - last_s)
        self._looks.append((time_s, expected_deg + math.remainder(reading.angle_deg - expected_deg, 360.0)))
        self._rate_dps = reading.rate_dps
