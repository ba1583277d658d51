"""Faults that a digitizer's scans show by themselves: a count that jumps, frozen inputs, a thermistor at its rail.

A converter is never so quiet that the codes of two inputs stay the same for seconds; a table is never so fast that its
encoder's count jumps between two scans; and a thermistor's amplifier is at the converter's rail if the thermistor is
open or shorted. The data are then invalid. The gyro may be at its rail because of its rate.
"""

from __future__ import annotations

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import ScanBlock

SPARE_COUNTS = 100.0
"""Counts allowed above the fastest table's motion in a scan interval: errors of the encoder, and vibration."""

AT_RAIL = 0.999  # as a fraction of the range


class ScanWatch:
    """Check the scans of one stream for faults; call `look` with every block, in order.

    Parameters
    ----------
    rate_hz
        The scan rate.
    fastest_counts_per_s
        Largest rate of the encoder's count; infinite: jumps are not checked.
    range_v
        The converter's ±range.
    frozen_s
        Time without a change on any input after which the inputs count as frozen; infinite: never.
    """

    def __init__(self, rate_hz: float, *, fastest_counts_per_s: float, range_v: float, frozen_s: float) -> None:
        self._range_v = range_v
        self._most_counts = fastest_counts_per_s / rate_hz + SPARE_COUNTS
        self._most_still = frozen_s * rate_hz
        self._rate_hz = rate_hz
        self._still = 0  # scans since the last change
        self._next_index = 0
        self._last: FloatArray | None = None  # the previous scan, shape (3, 1)

    def look(self, block: ScanBlock) -> None:
        """Raise `InstrumentError` if the count jumps, the thermistor is at its rail, or no input changes any more."""
        scans = np.stack([block.encoder_count.astype(np.float64), block.gyro_v, block.thermistor_v])
        first = block.first_index
        if self._last is not None and block.first_index == self._next_index:
            scans = np.concatenate([self._last, scans], axis=1)
            first -= 1
        else:
            self._still = 0
        steps = np.diff(scans, axis=1)
        self._last, self._next_index = scans[:, -1:], block.first_index + len(block.gyro_v)
        self._refuse_a_jump(steps[0], first)
        refuse_at_rail(float(np.median(block.thermistor_v)), self._range_v)
        changes = np.flatnonzero(steps.any(axis=0))
        self._still = self._still + steps.shape[1] if not len(changes) else steps.shape[1] - 1 - int(changes[-1])
        if self._still >= self._most_still:
            raise InstrumentError(
                f"count, gyro and thermistor have not changed by a single code for {self._still / self._rate_hz:.1f} s:"
                " the converter or its inputs hang; check the wiring and switch it off and on"
            )

    def _refuse_a_jump(self, steps: FloatArray, first: int) -> None:
        jumps = np.flatnonzero(np.abs(steps) > self._most_counts)
        if len(jumps):
            scan = first + int(jumps[0]) + 1
            raise InstrumentError(
                f"the encoder's count jumps by {int(steps[jumps[0]])} at scan {scan}"
                f" ({scan / self._rate_hz:.3f} s after the start of the stream), a table cannot turn so fast;"
                " check the encoder's cable and shield, its angle is lost"
            )


def refuse_at_rail(thermistor_v: float, range_v: float) -> None:
    """Raise `InstrumentError` if the thermistor's volts are at the end of the converter's range."""
    if abs(thermistor_v) >= AT_RAIL * range_v:
        raise InstrumentError(
            f"the thermistor reads {thermistor_v:+.2f} V, the end of its range: there is no temperature;"
            " check the thermistor, its amplifier and the wiring"
        )
