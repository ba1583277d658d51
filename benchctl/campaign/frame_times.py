"""When a digital gyro's frames were sampled: one even time line, which the jitter of their way does not enter.

    instant of sample i = instant of sample 0 + i / rate

The gyro's own numbers give i, its nominal rate the distance. A stamp says when the last sample of a block had reached
the host, so each block bounds the instant of sample 0 from above, and the one that was least late has the last word:
what is left is its delay, the least that a frame takes (on a simulated bench, whose clock leaps: up to one sample
interval). That is settled once, by the blocks up to the first `settle`;
later ones change nothing, so a crystal that is off by 20 ppm puts the end of an hour's step 0.07 s from its place.

Where the line was deaf for so long that the numbers may have wrapped, the samples from there on wait for the next
`settle`: their own blocks say how many whole wraps are missing. That is right while a frame takes less than half a wrap
to come; no sample is ever put before one that came earlier.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np

from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.interfaces import GyroBlock

UNKNOWN = 256.0
"""What is added to the status of a sample for which its gyro does not vouch, so that it is never 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Frames with their instants, by the clock of the stamps; every array of shape (n,), oldest first.

    `status` is 0 where the gyro vouches for the sample, otherwise 256 + its own. `missing` says how many samples are
    missing just before each.
    """

    time_s: FloatArray
    rate_dps: FloatArray
    temp_c: FloatArray
    status: FloatArray
    missing: IntArray


@dataclass(slots=True)
class _Stretch:
    """Blocks, or parts of them, between two places where the line was deaf."""

    zero_s: float = math.inf
    blocks: list[tuple[GyroBlock, slice]] = field(default_factory=list)


class FrameTimes:
    """Blocks and the stamps of their last samples in, frames with their instants out.

    Parameters
    ----------
    rate_hz
        The gyro's nominal rate.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._zero_s: float | None = None
        self._shift = 0  # samples in whole wraps that the gyro's numbers have missed
        self._unsettled: list[_Stretch] = []
        self._placed: list[Frames] = []
        self._next_index: int | None = None

    @property
    def is_settled(self) -> bool:
        """Whether the place of everything that has come is known, and something has come."""
        return self._zero_s is not None and not self._unsettled

    @property
    def reached_s(self) -> float:
        """The instant after the last sample whose place is known; -inf where there is none."""
        if self._zero_s is None or self._next_index is None:
            return -math.inf
        return self._zero_s + self._next_index / self._rate_hz

    def feed(self, block: GyroBlock, stamp_s: float) -> None:
        """Take a block whose last sample had come at `stamp_s`."""
        deaf = {gap.index for gap in block.gaps if not gap.exact}
        for first, last in itertools.pairwise(sorted({0, block.sequence.size} | deaf)):
            if first in deaf or (self._zero_s is None and not self._unsettled):
                self._unsettled.append(_Stretch())
            part = slice(first, last)
            if self._zero_s is not None and not self._unsettled:
                self._place(block, part, self._zero_s)
                continue
            stretch = self._unsettled[-1]
            stretch.zero_s = min(stretch.zero_s, stamp_s - float(block.sequence[last - 1]) / self._rate_hz)
            stretch.blocks.append((block, part))

    def settle(self, latest_zero_s: float = math.inf) -> None:
        """Find the place of whatever has none yet, from what has come by now.

        Where the stream fell silent at once no block may be fresh: `latest_zero_s` is when its first sample must have
        been taken, whatever the stamps say.
        """
        # What comes later can only have missed more, so its bound holds for what came before it as well.
        bounds_s = np.minimum.accumulate([stretch.zero_s for stretch in self._unsettled][::-1])[::-1]
        stretches, self._unsettled = self._unsettled, []
        for stretch, bound_s in zip(stretches, bounds_s.tolist(), strict=True):
            if self._zero_s is None:
                self._zero_s = min(bound_s, latest_zero_s)
            else:
                wrap = stretch.blocks[0][0].wrap
                missed = (bound_s - self._zero_s) * self._rate_hz - self._shift
                self._shift += max(0, round(missed / wrap)) * wrap
            for block, part in stretch.blocks:
                self._place(block, part, self._zero_s)

    def take(self, until_s: float) -> Frames:
        """All frames that were sampled before an instant and have not been taken."""
        waiting, self._placed = self._placed, []
        taken = [_of(frames, frames.time_s < until_s) for frames in waiting]
        left = [_of(frames, frames.time_s >= until_s) for frames in waiting]
        self._placed = [frames for frames in left if frames.time_s.size]
        return _joined(taken)

    def _place(self, block: GyroBlock, part: slice, zero_s: float) -> None:
        index = block.sequence[part] + self._shift
        before = index[0] - 1 if self._next_index is None else self._next_index - 1
        self._next_index = int(index[-1]) + 1
        self._placed.append(
            Frames(
                time_s=zero_s + index / self._rate_hz,
                rate_dps=block.rate_dps[part],
                temp_c=block.temperature_c[part],
                status=np.where(block.valid[part], 0.0, UNKNOWN + block.status[part]),
                missing=np.diff(index, prepend=before) - 1,
            )
        )


def _of(frames: Frames, those: BoolArray) -> Frames:
    return Frames(
        time_s=frames.time_s[those],
        rate_dps=frames.rate_dps[those],
        temp_c=frames.temp_c[those],
        status=frames.status[those],
        missing=frames.missing[those],
    )


def _joined(parts: list[Frames]) -> Frames:
    return Frames(
        time_s=np.concatenate([np.empty(0), *(part.time_s for part in parts)]),
        rate_dps=np.concatenate([np.empty(0), *(part.rate_dps for part in parts)]),
        temp_c=np.concatenate([np.empty(0), *(part.temp_c for part in parts)]),
        status=np.concatenate([np.empty(0), *(part.status for part in parts)]),
        missing=np.concatenate([np.empty(0, np.int64), *(part.missing for part in parts)]),
    )
