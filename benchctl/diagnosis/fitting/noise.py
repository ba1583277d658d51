"""The noise of a recording, and the filter that makes it white.

White noise σ² with slow processes s_i beside it, each remembering the share φ_i of itself from sample to sample and
driven by q_i·σ² (a random walk has φ = 1; flicker is a handful, one to less than a decade), has the spectrum

    σ²·(1 + Σ q_i/((1 − φ_i)² + φ_i·u)),   u = 2 − 2·cos(2πf·dt),

a ratio of polynomials in u whose zeros lie, each alone, between its poles. So the noise is the filter
Π(1 − ψ_j·B)/(1 − φ_i·B) of its own innovations, and the inverse, a chain of first-order sections, makes it white
(Harvey, Forecasting, structural time series models, 1989, ch. 2; Box & Jenkins, Time series analysis, ch. 4). Its
determinant is one: the likelihood of a model is that of its innovations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.signal

FloatArray = npt.NDArray[np.float64]

_FLICKER_RATIO = 5.0
"""Between the time constants of the processes that make flicker: its spectrum then ripples by less than 2 percent."""
_FORGOTTEN = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Slow:
    """One slow process: what it remembers of itself a sample later, and its drive over the white noise's variance."""

    remembers: float
    drive: float


def walk(per_root_s: float, interval_s: float) -> tuple[Slow, ...]:
    """A random walk of `per_root_s` [1/√s], in units of the deviation of the white noise."""
    return (Slow(remembers=1.0, drive=per_root_s**2 * interval_s),)


def flicker(rms_per_decade: float, interval_s: float, lasts_s: float) -> tuple[Slow, ...]:
    """Noise of one power in every decade, down to one over ten times `lasts_s`, in the same units.

    Near half the sampling rate, where white noise is far above it, it falls short: by 3 % at 0.007 of that rate, by
    28 % at 0.09.
    """
    count = max(2, math.ceil(math.log(10.0 * lasts_s / interval_s) / math.log(_FLICKER_RATIO)))
    variance = rms_per_decade**2 * math.log(_FLICKER_RATIO) / math.log(10.0)
    remembers = [math.exp(-(_FLICKER_RATIO ** (-0.5 - k))) for k in range(count)]
    return tuple(Slow(remembers=phi, drive=variance * (1.0 - phi**2)) for phi in remembers)


@dataclass(frozen=True, kw_only=True)
class Whitener:
    """Turns a column of data or of a prediction, shape (n,), into one whose noise is white and of one size.

    `slow` are the processes beside the white noise; `weight` (n,) is the inverse of a row's relative deviation, 0 where
    it does not count; `gaps` are the samples between each stretch and the one before it.
    """

    stretches: tuple[slice, ...]
    interval_s: float
    weight: FloatArray
    slow: tuple[Slow, ...] = ()
    time_s: FloatArray = field(default_factory=lambda: np.zeros(0))

    def beside(self, slow: tuple[Slow, ...]) -> Whitener:
        """The same rows with other slow processes."""
        return replace(self, slow=slow)

    @cached_property
    def zeros(self) -> tuple[float, ...]:
        """The ψ_j, one for each process."""
        return _zeros(self.slow)

    @cached_property
    def innovation(self) -> float:
        """Deviation of an innovation over that of the white noise."""
        ratio = 1.0
        for process, zero in zip(self.slow, self.zeros, strict=True):
            ratio *= process.remembers / zero
        return math.sqrt(ratio)

    @cached_property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the noise's covariance, but for the variance of the innovations."""
        counted = self.weight[self.weight > 0.0]
        return float(sum(math.log(power) for _, _, power in self._jumps) - 2.0 * np.log(counted).sum())

    def __call__(self, column: FloatArray) -> FloatArray:
        """The whitened column, shape (n,)."""
        if not self.slow:
            return column * self.weight
        values = column.copy()
        spoilt, before, after, share = self._bridges
        values[spoilt] = (1.0 - share) * values[before] + share * values[after]
        white: FloatArray = scipy.signal.sosfilt(self._sections, values)
        for part, response, power in self._jumps:
            rows = white[part]
            norm = float(response @ response)
            rows -= ((1.0 - 1.0 / math.sqrt(power)) / norm * float(response @ rows)) * response
        white *= self.weight
        return white

    @cached_property
    def _sections(self) -> FloatArray:
        return _sections([one.remembers for one in self.slow], self.zeros)

    @cached_property
    def _bridges(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64], FloatArray]:
        """Rows that do not count, and the rows between which they are bridged: the filter must not remember them."""
        good = np.flatnonzero(self.weight > 0.0)
        spoilt = np.flatnonzero(self.weight <= 0.0)
        if good.size == 0:
            return spoilt[:0], good, good, np.zeros(0)
        place = np.searchsorted(good, spoilt)
        before, after = good[np.maximum(place - 1, 0)], good[np.minimum(place, good.size - 1)]
        share = (spoilt - before) / np.maximum(after - before, 1)
        return spoilt, before, after, np.clip(share, 0.0, 1.0)

    @cached_property
    def _jumps(self) -> list[tuple[slice, FloatArray, float]]:
        """What a jump of the level during a gap does to a stretch: its rows, the whitened jump, 1 + its power.

        The level after a gap is known as far as the processes let it be. A jump of variance V, in units of that of an
        innovation, with the whitened form r adds V·r·rᵀ to the covariance; the root of its inverse is applied.
        """
        if not self.slow or len(self.stretches) < 2:
            return []
        longest = max(part.stop - part.start for part in self.stretches)
        response: FloatArray = scipy.signal.sosfilt(self._sections, np.ones(longest))
        small = np.flatnonzero(np.abs(response) < _FORGOTTEN)
        response = response[: int(small[0])] if small.size else response
        jumps = []
        for earlier, part in zip(self.stretches[:-1], self.stretches[1:], strict=True):
            gap = (self.time_s[part.start] - self.time_s[earlier.stop - 1]) / self.interval_s
            variance = sum(_wandered(one, gap) for one in self.slow) / self.innovation**2
            rows = slice(part.start, min(part.stop, part.start + response.size))
            here = response[: rows.stop - rows.start]
            power = 1.0 + variance * float(here @ here)
            if power > 1.0:
                jumps.append((rows, here, power))
        return jumps


def _wandered(process: Slow, samples: float) -> float:
    """Variance of the change of a process over so many samples."""
    if process.remembers >= 1.0:
        return float(process.drive * samples)
    return 2.0 * process.drive / (1.0 - process.remembers**2) * float(1.0 - process.remembers**samples)


def _zeros(slow: Sequence[Slow]) -> tuple[float, ...]:
    """The ψ of the innovations' filter: by bisection, in the logarithm of −u, between the poles and beyond the last."""
    poles = np.array([(1.0 - one.remembers) ** 2 / one.remembers for one in slow])
    drives = np.array([one.drive / one.remembers for one in slow])
    order = np.argsort(poles)
    poles, drives = poles[order], drives[order]
    found = []
    for i in range(poles.size):
        low = poles[i]
        high = poles[i + 1] if i + 1 < poles.size else poles[i] + drives.sum() + 1e-300
        for _ in range(200):
            middle = 0.5 * (low + high) if low <= 0.0 and high < 1e-300 else _between(low, high)
            # just beyond a pole the sum is −∞, and it grows towards the next
            if 1.0 + float(np.sum(drives / (poles - middle))) < 0.0:
                low = middle
            else:
                high = middle
        found.append(0.5 * (low + high))
    zeros = [1.0 + a / 2.0 - math.sqrt(a + a * a / 4.0) for a in found]
    ordered = np.empty(len(zeros))
    ordered[order] = zeros
    return tuple(ordered.tolist())


def _between(low: float, high: float) -> float:
    """Half way, in ratios where there are any."""
    return math.sqrt(low * high) if low > 0.0 else (high * 1e-3 if high > 1e-24 else high / 2)


def _sections(poles: Sequence[float], zeros: Sequence[float]) -> FloatArray:
    """Second-order sections (m, 6) of Π(1 − φ_i·B)/(1 − ψ_i·B), neighbours together."""
    pairs = sorted(zip(poles, zeros, strict=True))
    rows = []
    for i in range(0, len(pairs), 2):
        (a, b), (c, d) = pairs[i], pairs[i + 1] if i + 1 < len(pairs) else (0.0, 0.0)
        rows.append([1.0, -(a + c), a * c, 1.0, -(b + d), b * d])
    return np.array(rows)
