"""Unplanned motion that is faster than the band in which an encoder's angles give an accurate rate.

A shaft driven by a stepper shakes at every step, partly near half the sampling rate, where the encoder's resolution
noise hides it; the gyro senses all of it. Both are then compared only up to the edge of a band: anything above it is
neither predicted nor measured. Rows are thinned as far as that band allows, so that each remains independent.
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
"""Share of the band up to which its low-pass filter is flat."""
_ATTENUATION_DB = 80.0
_RESOLUTION_S = 10.0
_BIN_HZ = 0.4
_PIECE = 6
"""Number of consecutive windows over which a scale factor is assumed constant."""
_FILTER_S = 0.64
"""Length of the filter between encoder and gyro; a longer one resolves the lines of the two directions of rotation.

It would then fit the response to each of them separately, and hide a part of their difference.
"""
_FEWEST_BINS = 2
_EVEN = 4.0
"""Largest ratio of a bin's power to the median of the band that still counts as white noise."""
_ORDERS = 2
"""Orders per turn of a bias over the heading (once: Earth rotation, twice: a field) or of an encoder error."""
_MEAN_S = 0.25
"""These orders are estimated from means over this time, in which a shaking shaft does not appear."""
_SAME = 1e-6
"""Columns with a relative difference below this are treated as one; those of a swing over part of a turn nearly are."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """The compared part of a frame whose motion goes beyond its filters: low-passed values in a part of the rows.

    `stretches` are those of the frame; up to `up_to_hz` everything passes, beyond `stop_hz` nothing. `noise` is the
    standard deviation of the output's part that is not coherent with the rate, in the band and in the output's unit.
    """

    stretches: tuple[slice, ...]
    sample_rate_hz: float
    stop_hz: float
    noise: float = 0.0

    @property
    def up_to_hz(self) -> float:
        """The edge of the pass band."""
        return _PASSING * self.stop_hz

    @property
    def reach(self) -> int:
        """Number of rows on either side that contribute to a row."""
        return self._kernel.size // 2

    @cached_property
    def every(self) -> int:
        """One row out of this many is kept: the low-passed signal is below half of the reduced sampling rate."""
        return max(1, int(self.sample_rate_hz / (self.up_to_hz + self.stop_hz)))

    @cached_property
    def rows(self) -> IntArray:
        """Indices of the kept rows, shape (m,)."""
        return np.concatenate([np.arange(part.start, part.stop, self.every) for part in self.stretches])

    @cached_property
    def kept_stretches(self) -> tuple[slice, ...]:
        """The stretches, as slices of the kept rows."""
        bounds = np.searchsorted(self.rows, [part.start for part in self.stretches] + [self.stretches[-1].stop])
        return tuple(slice(first, last) for first, last in itertools.pairwise(bounds.tolist()))

    def slow(self, values: FloatArray) -> FloatArray:
        """Return the low-passed values, shape (n,), in the kept rows, shape (m,)."""
        return self.passed(values)[self.rows]

    def passed(self, values: FloatArray) -> FloatArray:
        """Return the low-passed values in every row, shape (n,)."""
        return filtered_along(self.stretches, values, self._kernel)

    @cached_property
    def _kernel(self) -> FloatArray:
        taps, beta = kaiserord(_ATTENUATION_DB, (self.stop_hz - self.up_to_hz) * 2.0 / self.sample_rate_hz)
        middle_hz = 0.5 * (self.up_to_hz + self.stop_hz)
        return np.asarray(firwin(taps | 1, middle_hz, window=("kaiser", beta), fs=self.sample_rate_hz))


def shared_motion(
    stretches: Sequence[slice], sample_rate_hz: float, angle_deg: FloatArray, volts: FloatArray
) -> FloatArray | None:
    """Predict volts from an encoder's angles by a linear filter, shape (n,), up to half the sampling rate.

    The filter is the optimal one at each frequency, S_xy/S_xx (Wiener), from all stretches together: it includes the
    output's delay and smoothing, and excludes what the two signals do not share. None if no stretch is long enough.
    """
    size = 1 << round(math.log2(_FILTER_S * sample_rate_hz))
    long = [part for part in stretches if part.stop - part.start >= 2 * size]
    if not long:
        return None
    turning = np.concatenate([np.gradient(angle_deg[part]) for part in stretches])
    crossed, power = np.zeros(size // 2 + 1, np.complex128), np.zeros(size // 2 + 1)
    for part in long:
        crossed += (part.stop - part.start) * csd(turning[part], volts[part], sample_rate_hz, nperseg=size)[1]
        power += (part.stop - part.start) * welch(turning[part], sample_rate_hz, nperseg=size)[1]
    kernel = np.roll(np.fft.irfft(crossed / np.maximum(power, 1e-300)), size // 2) * hann(size, sym=False)
    return filtered_along(stretches, turning, kernel[1:])


def band_of(
    stretches: tuple[slice, ...], sample_rate_hz: float, angle_deg: FloatArray, rate_dps: FloatArray, volts: FloatArray
) -> Band:
    """Return the band in which the incoherent part of encoder and gyro is as even as noise; arrays of shape (n,).

    The part that is not proportional to the rate, frequency by frequency, is noise, an error of either signal, or
    motion faster than half the sampling rate that appears as aliased lines. The band ends before the first of these
    lines. A heading-dependent bias and an eccentric encoder also have lines, at the frequencies of the slow motion:
    they are compared and do not limit the band. The band's noise is measured separately in each minute, so that a scale
    factor that changes during the recording does not count as noise.
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
    """Subtract from volts what depends on the heading, fitted with a bias and a scale factor to means over `rows`."""
    turns = np.outer(np.arange(1, _ORDERS + 1), np.radians(angle_deg))
    share = rate_dps / max(float(np.abs(rate_dps).max()), 1e-300)
    of_bias = np.concatenate([np.cos(turns), np.sin(turns)])
    columns = np.vstack([of_bias, of_bias * share, np.ones_like(share), share])
    used = share.size // rows * rows
    means, mean_volts = (one[..., :used].reshape(*one.shape[:-1], -1, rows).mean(axis=-1) for one in (columns, volts))
    shares = np.linalg.lstsq(means.T, mean_volts, rcond=_SAME)[0]
    return np.asarray(volts - shares[:-2] @ columns[:-2])


def _not_shared(rate_dps: FloatArray, volts: FloatArray, sample_rate_hz: float, size: int) -> FloatArray:
    """Return the power density of the part of volts that is not coherent with a rate, corrected for the fit's bias."""
    of_rate = welch(rate_dps, sample_rate_hz, nperseg=size)[1]
    both = csd(rate_dps, volts, sample_rate_hz, nperseg=size)[1]
    left = welch(volts, sample_rate_hz, nperseg=size)[1] - np.abs(both) ** 2 / np.maximum(of_rate, 1e-300)
    averages = INDEPENDENT * (2 * rate_dps.size // size - 1)
    return np.asarray(np.maximum(left, 0.0) / max(1.0 - 1.0 / averages, INDEPENDENT))
