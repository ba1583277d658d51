"""The table's rate and acceleration by the digitizer's count, whatever its controller says of them."""

from __future__ import annotations

import math

import numpy as np

from benchctl.bench import Bench
from instruments.interfaces import FloatArray, IntArray

LOOK_S = 0.05
"""A rate is taken over this time: a count of a coarse encoder is then no great rate."""

ERROR_SHARE = 0.025
"""What the encoder's errors may add to an acceleration, as a share of the bench's limit: half of what is granted."""


class EncoderMotion:
    """Follows one stream's counts, block by block.

    An acceleration is the change of the mean rate from one interval to the next, over the interval T: a mean of the
    true one, weighted, and never above its peak. An angle that is off by e, by rounding or by the encoder's accuracy,
    makes up to 4·e/T² of it; so T is as long as it takes to keep that below `ERROR_SHARE` of the bench's limit. For
    360,000 counts a turn and 1500 deg/s² that is `LOOK_S`, and rounding makes up to 0.8 deg/s².

    Parameters
    ----------
    bench
        Whose encoder and whose limit.
    rate_hz
        Scans a second.
    """

    def __init__(self, bench: Bench, rate_hz: float) -> None:
        entry = bench.digitizer
        self._degrees_per_count = entry.encoder_sign * 360.0 / entry.encoder_counts_per_rev
        self._rate_hz = rate_hz
        error_deg = max(0.5 * abs(self._degrees_per_count), entry.encoder_accuracy_arcsec / 3600.0)
        longer_s = math.sqrt(4.0 * error_deg / (ERROR_SHARE * bench.limits.acceleration_dps2))
        self._rate_stride = max(1, round(LOOK_S * rate_hz))
        self._stride = max(1, math.ceil(max(LOOK_S, longer_s) * rate_hz))
        self._tail = np.empty(0, dtype=np.int64)
        self._next_index = 0

    def rates_dps(self, count: IntArray) -> FloatArray:
        """Mean rates over `LOOK_S` each, of scans without a gap; none of fewer scans than that."""
        return np.diff(count[:: self._rate_stride]) * (self._degrees_per_count * self._rate_hz / self._rate_stride)

    def accelerations_dps2(self, first_index: int, count: IntArray) -> FloatArray:
        """The accelerations up to each of these scans, from those before where there is no gap between."""
        if first_index != self._next_index:
            self._tail = self._tail[:0]
        self._next_index = first_index + len(count)
        known, stride = np.concatenate((self._tail, count)), self._stride
        self._tail = known[-2 * stride :]
        bends = known[2 * stride :] - 2 * known[stride:-stride] + known[: -2 * stride]
        per_s = self._rate_hz / stride
        return bends.astype(np.float64) * (self._degrees_per_count * per_s * per_s)
