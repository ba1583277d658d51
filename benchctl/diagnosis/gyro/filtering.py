"""Linear filters and time shifts of band-limited samples: exact as products in frequency, and by splines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.fft
from scipy.ndimage import map_coordinates, spline_filter1d

from benchctl_instruments.arrays import ComplexArray, FloatArray
from benchctl_instruments.physics.effects.kinds import FilterEffect

_TURNED_ROWS = 64
_LEAST_S, _LONGER, _MOST_S = 0.25, 4.0, 60.0
_KEPT = 3
_DEGREE = 5
_TOGETHER = 1 << 19
"""Number of samples that are filtered at once."""


class Filters:
    """Linear filters for equidistant samples of each stretch; samples outside all stretches are unchanged.

    The spectra of the last filtered signals are kept, as many filters are applied to one signal. Thread-safe.
    """

    def __init__(self, stretches: Sequence[slice], interval_s: float) -> None:
        self._interval_s = interval_s
        self._by_length: dict[int, list[slice]] = {}
        for rows in stretches:
            self._by_length.setdefault(rows.stop - rows.start, []).append(rows)
        self._kept: list[tuple[FloatArray, int, list[ComplexArray]]] = []

    def __call__(self, values: FloatArray, effect: FilterEffect) -> FloatArray:
        """Filter values (n,), which must not be modified afterwards."""
        padding = self._padding(effect.memory_s)
        spectra = iter(self._spectra(values, padding))
        passed = values.copy()
        gains: dict[int, ComplexArray] = {}
        for length, size, alike in self._batches(padding):
            if size not in gains:
                gains[size] = effect.response(scipy.fft.rfftfreq(size, self._interval_s))
            for rows, back in zip(alike, scipy.fft.irfft(next(spectra) * gains[size], size), strict=True):
                passed[rows] = back[:length]
        return passed

    def _padding(self, memory_s: float) -> int:
        """Return the samples until a filter has decayed, from a few fixed numbers, so that filters share spectra."""
        steps = math.ceil(math.log(max(memory_s, _LEAST_S) / _LEAST_S, _LONGER))
        return int(min(_LEAST_S * _LONGER**steps, _MOST_S) / self._interval_s) + 2 * _TURNED_ROWS

    def _batches(self, padding: int) -> Iterator[tuple[int, int, list[slice]]]:
        """Yield stretches of equal length in batches, with the length and the size of their transforms."""
        for length, alike in self._by_length.items():
            size = scipy.fft.next_fast_len(length + 2 * padding, real=True)
            many = max(1, _TOGETHER // size)
            for first in range(0, len(alike), many):
                yield length, size, alike[first : first + many]

    def _spectra(self, values: FloatArray, padding: int) -> list[ComplexArray]:
        for of, padded, spectra in tuple(self._kept):
            if of is values and padded == padding:
                return spectra
        spectra = [
            scipy.fft.rfft(_endless(np.stack([values[rows] for rows in alike]), size))
            for _, size, alike in self._batches(padding)
        ]
        self._kept = [*self._kept[1 - _KEPT :], (values, padding, spectra)]
        return spectra


def spline_at(values: FloatArray, place: FloatArray) -> FloatArray:
    """Interpolate equidistant values at fractional indices, shape (n,)."""
    if values.size <= _DEGREE:
        return values
    line = np.linspace(values[0], values[-1], values.size)
    coefficients = spline_filter1d(values - line, _DEGREE, mode="mirror")  # type: ignore[call-overload]  # the stubs declare only lists
    between: FloatArray = map_coordinates(  # type: ignore[call-overload]  # the stubs declare no list of coordinates
        coefficients, [place], order=_DEGREE, mode="mirror", prefilter=False
    )
    slope = (values[-1] - values[0]) / max(values.size - 1, 1)
    shifted: FloatArray = between + values[0] + slope * place
    return shifted


def _endless(x: FloatArray, size: int) -> FloatArray:
    """Return periods, shape (k, size), that start with x (k, n) and return to its start without a jump or a kink.

    Beyond its ends x is continued point-symmetrically and fades out: a kink would ring at half the sample rate.
    """
    count = x.shape[1]
    reach = min(_TURNED_ROWS, count - 1)
    fading = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, reach + 1) / (reach + 1))
    long = np.empty((len(x), size))
    long[:, :count] = x
    begin, end = x[:, :1], x[:, -1:]
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, size - count))
    long[:, count:] = end + (begin - end) * ramp
    if reach:
        long[:, count : count + reach] += fading * (end - x[:, -2 : -2 - reach : -1])
        long[:, size - reach :] += (fading * (begin - x[:, 1 : reach + 1]))[:, ::-1]
    return long
