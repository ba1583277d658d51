"""Motion that nobody planned: faster than the band in which an encoder's angles make a good rate.

A shaft that a stepper drives shakes at every step, some of it near half the sampling rate, where the encoder's steps
drown it. The gyro feels it all. Both are then compared only up to the edge of a band: what lies above it is neither
predicted nor measured. Rows are kept as sparsely as that band allows, so that each still counts for itself.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import csd, firwin, kaiserord, welch
from scipy.signal.windows import hann

from benchctl.signals.rate import NARROW, edges_hz, filtered_along
from benchctl.signals.windows import INDEPENDENT
from benchctl_instruments.arrays import FloatArray, IntArray

_PASSING = 0.6
"""Share of the band up to which its low pass is flat."""
_ATTENUATION_DB = 80.0
_RESOLUTION_S = 10.0
_BIN_HZ = 0.4
_PIECE = 6
"""Windows, one behind the other, over which a scale factor is taken to stay what it is."""
_FILTER_S = 0.64
"""Length of the filter between encoder and gyro: a longer one tells the lines of the two directions of rotation apart.

It then learns how each of them is felt, and hides a part of what differs between them.
"""
_FEWEST_BINS = 2
_EVEN = 4.0
"""A bin's power over the median of the band's, up to which it still passes for white noise."""
_ORDERS = 2
"""So often in a turn a bias over the heading repeats (the Earth's rotation once, a field twice), or an encoder errs."""
_MEAN_S = 0.25
"""How much of them there is, is asked of means over so long, in which a shaking shaft does not show."""
_SAME = 1e-6
"""Columns that differ by less, as a share, are one: of a swing over a part of a turn they nearly are."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """What is compared of a frame whose motion goes beyond its filters: slow parts, and of the rows some.

    `stretches` are those of the frame; up to `up_to_hz` everything passes, beyond `stop_hz` nothing. `noise` is the
    deviation of what of the output is not shared in the band, in its unit.
    """

    stretches: tuple[slice, ...]
    sample_rate_hz: float
    stop_hz: float
    noise: float = 0.0

    @property
    def up_to_hz(self) -> float:
        """The edge up to which everything is compared."""
        return _PASSING * self.stop_hz

    @property
    def reach(self) -> int:
        """Rows on either side that a row is made of."""
        return self._kernel.size // 2

    @cached_property
    def every(self) -> int:
        """Of so many rows one is kept: what the low pass leaves fits below half of the rate that remains."""
        return max(1, int(self.sample_rate_hz / (self.up_to_hz + self.stop_hz)))

    @cached_property
    def rows(self) -> IntArray:
        """The rows that are kept, shape (m,)."""
        return np.concatenate([np.arange(part.start, part.stop, self.every) for part in self.stretches])

    @cached_property
    def kept_stretches(self) -> tuple[slice, ...]:
        """The stretches in the rows that are kept."""
        bounds = np.searchsorted(self.rows, [part.start for part in self.stretches] + [self.stretches[-1].stop])
        return tuple(slice(first, last) for first, last in itertools.pairwise(bounds.tolist()))

    def slow(self, values: FloatArray) -> FloatArray:
        """The low-passed values, shape (n,), in the rows that are kept, shape (m,)."""
        return self.passed(values)[self.rows]

    def passed(self, values: FloatArray) -> FloatArray:
        """The low-passed values in every row, shape (n,)."""
        return filtered_along(self.stretches, values, self._kernel)

    @cached_property
    def _kernel(self) -> FloatArray:
        taps, beta = kaiserord(_ATTENUATION_DB, (self.stop_hz - self.up_to_hz) * 2.0 / self.sample_rate_hz)
        middle_hz = 0.5 * (self.up_to_hz + self.stop_hz)
        return np.asarray(firwin(taps | 1, middle_hz, window=("kaiser", beta), fs=self.sample_rate_hz))


def shared_motion(
    stretches: Sequence[slice], sample_rate_hz: float, angle_deg: FloatArray, volts: FloatArray
) -> FloatArray | None:
    """What of volts an encoder's angles foretell by a linear filter, shape (n,), up to half the sampling rate.

    The filter is the best in each frequency, S_xy/S_xx (Wiener), of all stretches together: with the output's delay,
    its own smoothing and nothing of what the two do not share. None where no stretch is long enough.
    """
    size = 1 << round(math.log2(_FILTER_S * sample_rate_hz))
    long = [part for part in stretches if part.stop - part.start >= 2 * size]
    if not long:
        return None
    seen = np.concatenate([np.gradient(angle_deg[part]) for part in stretches])
    crossed, power = np.zeros(size // 2 + 1, np.complex128), np.zeros(size // 2 + 1)
    for part in long:
        crossed += (part.stop - part.start) * csd(seen[part], volts[part], sample_rate_hz, nperseg=size)[1]
        power += (part.stop - part.start) * welch(seen[part], sample_rate_hz, nperseg=size)[1]
    kernel = np.roll(np.fft.irfft(crossed / np.maximum(power, 1e-300)), size // 2) * hann(size, sym=False)
    return filtered_along(stretches, seen, kernel[1:])


def band_of(
    stretches: tuple[slice, ...], sample_rate_hz: float, angle_deg: FloatArray, rate_dps: FloatArray, volts: FloatArray
) -> Band:
    """The band in which what encoder and gyro do not share is as even as noise: from arrays of shape (n,).

    What is not in proportion to the rate, frequency by frequency, is noise, an error of either, or motion faster than
    half the sampling rate, folded back into lines. The band ends before the first of these. A bias that depends on the
    heading, and an eccentric encoder, have lines too, of the slow motion itself: they are compared and end nothing. The
    band's noise is measured in every minute by itself, so that a scale factor that changes during the recording does
    not count as noise.
    """
    longest = max(stretches, key=lambda part: part.stop - part.start)
    rate = rate_dps[longest]
    output = _without_heading(volts[longest], angle_deg[longest], rate, max(round(_MEAN_S * sample_rate_hz), 1))
    size = min(1 << round(math.log2(_RESOLUTION_S * sample_rate_hz)), rate.size)
    frequency = np.fft.rfftfreq(size, 1.0 / sample_rate_hz)
    left = _not_shared(rate, output, sample_rate_hz, size)
    wide = max(1, round(_BIN_HZ / float(frequency[1])))
    inside = (frequency > 0.0) & (frequency <= edges_hz(NARROW, sample_rate_hz)[1])
    bins = left[inside][: inside.sum() // wide * wide].reshape(-1, wide).mean(axis=1)
    even = [bool(bins[:k].max() <= _EVEN * np.median(bins[:k])) for k in range(1, bins.size + 1)]
    count = max(even.index(False) if False in even else len(even), _FEWEST_BINS)
    stop_hz = count * wide * float(frequency[1])
    passed = (frequency > 0.0) & (frequency <= 0.5 * (1.0 + _PASSING) * stop_hz)
    piece = _PIECE * size
    pieces = [slice(first, first + piece) for first in range(0, rate.size - piece + 1, piece)] or [slice(None)]
    power = float(np.mean([_not_shared(rate[one], output[one], sample_rate_hz, size)[passed].sum() for one in pieces]))
    return Band(
        stretches=stretches, sample_rate_hz=sample_rate_hz, stop_hz=stop_hz, noise=math.sqrt(power * frequency[1])
    )


def _without_heading(volts: FloatArray, angle_deg: FloatArray, rate_dps: FloatArray, rows: int) -> FloatArray:
    """Volts without what the heading may bring beside a bias and a scale factor, by means over so many rows."""
    turns = np.outer(np.arange(1, _ORDERS + 1), np.radians(angle_deg))
    share = rate_dps / max(float(np.abs(rate_dps).max()), 1e-300)
    of_bias = np.concatenate([np.cos(turns), np.sin(turns)])
    columns = np.vstack([of_bias, of_bias * share, np.ones_like(share), share])
    whole = share.size // rows * rows
    means, mean_volts = (one[..., :whole].reshape(*one.shape[:-1], -1, rows).mean(axis=-1) for one in (columns, volts))
    shares = np.linalg.lstsq(means.T, mean_volts, rcond=_SAME)[0]
    return np.asarray(volts - shares[:-2] @ columns[:-2])


def _not_shared(rate_dps: FloatArray, volts: FloatArray, sample_rate_hz: float, size: int) -> FloatArray:
    """The power density of what of volts is not in proportion to a rate, frequency by frequency, without bias."""
    of_rate = welch(rate_dps, sample_rate_hz, nperseg=size)[1]
    both = csd(rate_dps, volts, sample_rate_hz, nperseg=size)[1]
    left = welch(volts, sample_rate_hz, nperseg=size)[1] - np.abs(both) ** 2 / np.maximum(of_rate, 1e-300)
    averages = INDEPENDENT * (2 * rate_dps.size // size - 1)
    return np.asarray(np.maximum(left, 0.0) / max(1.0 - 1.0 / averages, INDEPENDENT))
