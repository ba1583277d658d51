"""Spectra of evenly sampled signals over half-overlapping Hann windows, for cross-spectra and transfer functions.

Source: Bendat & Piersol, Random data, 4th ed. 2010, ch. 9 and 11 (Welch's method for two signals).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from scipy.signal.windows import hann

from benchctl.recordings.runs import holding
from benchctl_instruments.arrays import BoolArray, ComplexArray, FloatArray, IntArray

INDEPENDENT = 0.5
"""Share of half-overlapping Hann windows that count as independent averages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """Windows of `size` samples that begin at the rows `starts` (w,), in order."""

    starts: IntArray
    size: int
    interval_s: float

    @property
    def frequency_hz(self) -> FloatArray:
        """The frequencies of the bins [Hz], shape (size // 2 + 1,)."""
        return scipy.fft.rfftfreq(self.size, self.interval_s)

    def spectra(self, values: FloatArray, bins: IntArray) -> ComplexArray:
        """Return the spectrum of values (n,) in each window minus its mean, at some bins (k,), shape (w, k)."""
        cut = np.lib.stride_tricks.sliding_window_view(values, self.size)[self.starts]
        cut = (cut - cut.mean(axis=1, keepdims=True)) * hann(self.size, sym=False)
        return np.asarray(scipy.fft.rfft(cut, axis=1)[:, bins])


def windows_of(usable: BoolArray, stretches: Sequence[slice], size: int, interval_s: float) -> Windows:
    """Return the windows in gap-free stretches that contain only usable rows, (n,)."""
    starts = [
        part.start + run.start + np.arange(0, run.stop - run.start - size + 1, size // 2)
        for part in stretches
        for run in holding(usable[part])
    ]
    return Windows(
        starts=np.concatenate([np.zeros(0, np.int64), *starts]).astype(np.int64), size=size, interval_s=interval_s
    )
