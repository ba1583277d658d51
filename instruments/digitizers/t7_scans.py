"""From the bytes of a T7's stream to counts and volts: what a scan of this bench holds, and what its codes mean.

| count, low word | count, high word | gyro code | thermistor code |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import InstrumentError
from benchctl_instruments.interfaces import ScanBlock
from benchctl_instruments.protocols.t7_stream import SampleArray, ScanRun, StreamReader

SCAN_LENGTH = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class AinCalibration:
    """The T7's constants of one range: volts = (code - centre) · slope, with a slope [V] for each side of the centre.

    The slope of the lower side is negative and is applied to centre - code (T-series datasheet 20.0.1).
    """

    positive_slope: float
    negative_slope: float
    centre: float

    def check(self, range_v: float) -> None:
        """Raise `InstrumentError` where these cannot be the constants of a 16-bit converter over ±`range_v`."""
        slope = 2.0 * range_v / 65536
        expected = ((self.positive_slope, slope), (self.negative_slope, -slope), (self.centre, 32768.0))
        if not all(math.isclose(got, nominal, rel_tol=0.1) for got, nominal in expected):
            raise InstrumentError(
                f"expected the calibration of the ±{range_v:g} V range, slopes near ±{slope:.4g}, a centre near 32768, "
                f"got {self.positive_slope:.4g}, {self.negative_slope:.4g} and {self.centre:.6g}"
            )

    def volts(self, codes: SampleArray) -> FloatArray:
        """Volts of streamed codes, shape as given."""
        from_centre = codes.astype(np.float64) - self.centre
        slopes: FloatArray = np.where(from_centre < 0.0, -self.negative_slope, self.positive_slope)
        return from_centre * slopes


class ScanQueue:
    """The scans of one stream that have come and were not taken yet; bytes in, blocks out."""

    def __init__(self, calibration: AinCalibration) -> None:
        self._calibration = calibration
        self._reader = StreamReader(SCAN_LENGTH)
        self._runs: list[ScanRun] = []
        self._last_count: int | None = None

    @property
    def junk_bytes(self) -> int:
        """How many bytes of the stream belonged to no packet."""
        return self._reader.junk_bytes

    def resume(self) -> None:
        """Go on with the bytes of a new connection of the same stream."""
        self._reader.resume()

    def feed(self, data: bytes) -> None:
        """Take bytes as they come; raises as `StreamReader.feed` does."""
        for run in self._reader.feed(data):
            if self._runs and self._runs[-1].next_index == run.first_index:
                self._runs[-1] = _joined(self._runs[-1], run)
            else:
                self._runs.append(run)

    def ready(self, scans: int) -> bool:
        """Whether a block of that many scans can be taken, or a shorter one that a gap ends."""
        return self.waiting >= scans or len(self._runs) > 1

    @property
    def waiting(self) -> int:
        """How many scans wait up to the next gap."""
        return len(self._runs[0].samples) if self._runs else 0

    def take(self) -> ScanBlock:
        """All scans that wait up to the next gap; there must be some."""
        run = self._runs.pop(0)
        return ScanBlock(
            first_index=run.first_index,
            encoder_count=self._unwrapped(run.samples[:, 0], run.samples[:, 1]),
            gyro_v=self._calibration.volts(run.samples[:, 2]),
            thermistor_v=self._calibration.volts(run.samples[:, 3]),
            backlog=self._reader.backlog_scans,
        )

    def _unwrapped(self, low: SampleArray, high: SampleArray) -> IntArray:
        """Signed counts that go on where the counter's 32 bits wrap, across gaps too."""
        count = (low | high.astype(np.uint32) << 16).view(np.int32).astype(np.int64)
        before = int(count[0]) if self._last_count is None else self._last_count
        steps = np.diff(count, prepend=before)
        unwrapped = before + np.cumsum((steps + 0x80000000) % 0x100000000 - 0x80000000)
        self._last_count = int(unwrapped[-1])
        return unwrapped


def _joined(first: ScanRun, then: ScanRun) -> ScanRun:
    return ScanRun(first_index=first.first_index, samples=np.concatenate((first.samples, then.samples)))
