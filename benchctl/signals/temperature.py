"""The gyro's thermistor over a complete recording: denoised, with its rate of change, and through its pauses.

A campaign records one stream per step, seconds long, and reads the thermistor occasionally during a soak. A slope from
one such stream is only noise. So all readings are averaged on one grid of one second, and a straight line is fitted
around each grid point, over a time that grows until it contains enough samples: two for the temperature, many for the
slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.signal import oaconvolve

from benchctl_instruments.arrays import FloatArray

_CELL_S = 1.0
_REACHES_S = (6.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0)
"""Half-widths of a line fit, with weights that decrease with distance; the time constant of a housing is minutes."""

_STEADY = 50.0
"""A half-width suffices if the slope's error [°C/s] is at most a sample's noise [°C] divided by this many seconds."""

_PAUSE_S = 15.0
_MOST_POINTS = 2000


class Readings(NamedTuple):
    """Times [s] and temperatures [°C], shape (n,) each, in any order; each is the mean of `samples` samples."""

    time_s: FloatArray
    temp_c: FloatArray
    samples: FloatArray | float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pause:
    """The thermistor [°C] between two stretches, at equidistant `time_s`; arrays of shape (n,)."""

    interval_s: float
    time_s: FloatArray
    temp_c: FloatArray
    temp_rate_c_per_s: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Thermistor:
    """Temperature [°C] and its slope [°C/s] on a grid of cells, shape (m,), the first one at `begin_s`."""

    begin_s: float
    temp_c: FloatArray
    temp_rate_c_per_s: FloatArray
    known: npt.NDArray[np.bool_]
    """Cells that contain a measurement, shape (m,)."""

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return temperature and slope at the given times, shape (n,) each."""
        place = (time_s - self.begin_s) / _CELL_S - 0.5
        cells = np.arange(self.temp_c.size)
        return np.interp(place, cells, self.temp_c), np.interp(place, cells, self.temp_rate_c_per_s)

    def pause(self, from_s: float, to_s: float) -> Pause | None:
        """Return the readings in a pause; None if it is short, or nothing was measured in it."""
        first, last = (int((at - self.begin_s) / _CELL_S) for at in (from_s, to_s))
        if to_s - from_s < _PAUSE_S or not self.known[first + 1 : last].any():
            return None
        count = min(_MOST_POINTS, int((to_s - from_s) / _CELL_S))
        time_s = np.linspace(from_s, to_s, count + 1)[1:-1] if count > 2 else np.array([0.5 * (from_s + to_s)])
        temp, rate = self.at(time_s)
        interval_s = float(time_s[1] - time_s[0]) if time_s.size > 1 else _CELL_S
        return Pause(interval_s=interval_s, time_s=time_s, temp_c=temp, temp_rate_c_per_s=rate)


def thermistor_of(measured: Sequence[Readings]) -> Thermistor:
    """Combine all readings of the thermistor."""
    time_s = np.concatenate([one.time_s for one in measured])
    temp_c = np.concatenate([one.temp_c for one in measured])
    samples = np.concatenate([np.broadcast_to(one.samples, one.time_s.shape) for one in measured])
    finite = np.isfinite(temp_c)
    time_s, temp_c, samples = time_s[finite], temp_c[finite], samples[finite]
    begin_s, level_c = float(time_s.min()), float(np.median(temp_c))
    cell = ((time_s - begin_s) / _CELL_S).astype(np.int64)
    size = int(cell.max()) + 1
    offset = time_s - begin_s - (cell + 0.5) * _CELL_S
    sums = [
        np.bincount(cell, samples * values, minlength=size).astype(np.float64)
        for values in (np.ones_like(offset), offset, offset**2, temp_c - level_c, (temp_c - level_c) * offset)
    ]
    temp, rate = np.full(size, np.nan), np.full(size, np.nan)
    for reach_s in _REACHES_S:
        here, slope, spread = _lines(sums, reach_s)
        valued, steady = np.isnan(temp) & (spread > _CELL_S**2), np.isnan(rate) & (spread > _STEADY**2)
        temp[valued], rate[steady] = here[valued], slope[steady]
    known = sums[0] > 0.0
    if np.isnan(rate).any() or np.isnan(temp).any():
        temp, rate = _without_holes(sums, temp, rate)
    return Thermistor(begin_s=begin_s, temp_c=temp + level_c, temp_rate_c_per_s=rate, known=known)


def _lines(sums: Sequence[FloatArray], reach_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the line's value at every cell, its slope, and Σ w·(t − mean t)²: each of shape (m,)."""
    reach = round(reach_s / _CELL_S)
    k = np.arange(-reach, reach + 1) * _CELL_S
    near = (1.0 - np.abs(k / (reach_s + _CELL_S)) ** 3) ** 3
    w0, w1, w2, y0, y1 = sums

    def around(values: FloatArray, kernel: FloatArray) -> FloatArray:
        total: FloatArray = oaconvolve(values, kernel[::-1], mode="same" if values.size >= kernel.size else "full")
        return total if total.size == values.size else total[reach : reach + values.size]

    n = np.maximum(around(w0, near), 0.0)
    n = np.where(n > 1e-6, n, np.inf)
    t = (around(w1, near) + around(w0, near * k)) / n
    tt = (around(w2, near) + 2.0 * around(w1, near * k) + around(w0, near * k * k)) / n
    y = around(y0, near) / n
    ty = (around(y1, near) + around(y0, near * k)) / n
    variance = tt - t * t
    slope = (ty - t * y) / np.maximum(variance, 1e-9)
    return y - slope * t, slope, np.where(np.isfinite(n), n, 0.0) * variance


def _without_holes(sums: Sequence[FloatArray], temp: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Interpolate linearly where no line could be fitted: in a pause of hours, or with very few samples."""
    cells = np.arange(temp.size)
    fitted, measured = np.flatnonzero(~np.isnan(temp)), np.flatnonzero(sums[0] > 0.0)
    if fitted.size:
        filled = np.interp(cells, fitted, temp[fitted])
    else:
        filled = np.interp(cells, measured, sums[3][measured] / sums[0][measured])
    slope = np.gradient(filled, _CELL_S) if filled.size > 1 else np.zeros_like(filled)
    return filled, np.where(np.isnan(rate), slope if fitted.size else 0.0, rate)
