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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy.optimize
import scipy.signal

from benchctl.estimation.filtered_runs import filtered, without_innovations
from benchctl_instruments.arrays import FloatArray, IntArray

_FLICKER_RATIO = 5.0
"""Between the time constants of the processes that make flicker: its spectrum then ripples by less than 2 percent."""
_SHAPED, _SLOWEST, _SHAPED_FROM = 5, 16, 1e-4
"""So many of the fastest are of sizes of their own, among so many, over frequencies from this share of the rate."""
_FORGOTTEN = 1e-3
_BRIDGED = 3
"""So many rows in a row that do not count are bridged; more of them are a pause."""


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

    Its density is right to 3 % up to a tenth of the sampling rate, to 6 % up to four tenths.
    """
    count = max(_SHAPED + 1, math.ceil(math.log(10.0 * lasts_s / interval_s) / math.log(_FLICKER_RATIO)))
    shares = [*_fastest(), *[2.0 * math.log(_FLICKER_RATIO)] * (count - _SHAPED)]
    unit = rms_per_decade**2 / (2.0 * math.log(10.0))
    remembers = [math.exp(-(_FLICKER_RATIO**-k)) for k in range(count)]
    return tuple(
        Slow(remembers=phi, drive=unit * share * (1.0 - phi**2)) for phi, share in zip(remembers, shares, strict=True)
    )


@lru_cache(maxsize=1)
def _fastest() -> tuple[float, ...]:
    """Variances of the fastest processes beside which equal ones make the two-sided density 1/f, by least squares.

    Samples fold what is above half their rate, so equal ones would make too little of it below.
    """
    frequency = np.geomspace(_SHAPED_FROM, 0.5, 1000)
    lag = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency)
    remembers = np.exp(-(_FLICKER_RATIO ** -np.arange(_SLOWEST, dtype=np.float64)))
    density = (1.0 - remembers**2) / ((1.0 - remembers) ** 2 + remembers * lag[:, None]) * frequency[:, None]
    rest = 1.0 - 2.0 * math.log(_FLICKER_RATIO) * density[:, _SHAPED:].sum(axis=1)
    return tuple(scipy.optimize.nnls(density[:, :_SHAPED], rest)[0].tolist())


@dataclass(frozen=True, kw_only=True)
class Whitener:
    """Turns columns of data or of predictions, shape (n,) or (k, n), into ones whose noise is white and of one size.

    `slow` are the processes beside the white noise; `weight` (n,) is the inverse of a row's relative deviation, 0 where
    it does not count; `time_s` (n,) says where rows are missing, and may be left away where none are.
    """

    interval_s: float
    weight: FloatArray
    slow: tuple[Slow, ...] = ()
    time_s: FloatArray = field(default_factory=lambda: np.zeros(0))

    def beside(self, slow: tuple[Slow, ...]) -> Whitener:
        """The same rows with other slow processes."""
        other = replace(self, slow=slow)
        other.__dict__["_rows"] = self._rows  # what follows from the rows alone is found once
        return other

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
    def usual(self) -> float:
        """The weight of a usual row, beside whose white noise the processes are seen."""
        counted = self.weight[self._rows.counted]
        return float(np.median(counted)) if counted.size else 1.0

    @cached_property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the noise's covariance, but for the variance of the innovations."""
        jumps = sum(math.log(power) for _, _, power in self._jumps)
        return jumps + self._rows.log_determinant

    def __call__(self, column: FloatArray) -> FloatArray:
        """The whitened column, shape (n,), or several, shape (k, n)."""
        if not self.slow:
            return column * self.weight
        values = np.atleast_2d(column).copy()
        spoilt, before, after, share = self._rows.bridges
        values[:, spoilt] = (1.0 - share) * values[:, before] + share * values[:, after]
        white = filtered(self._sections, values, [rows for rows, _ in self._rows.runs], self._carried)
        white *= self.weight
        for rows, response, power in self._jumps:
            part = white[:, rows]
            known = (1.0 - 1.0 / math.sqrt(power)) / float(response @ response)
            part -= np.multiply.outer(known * (part @ response), response)
        return white.reshape(column.shape)

    @cached_property
    def _rows(self) -> _Rows:
        return _Rows(self.interval_s, self.weight, self.time_s)

    @cached_property
    def _sections(self) -> FloatArray:
        return _sections([one.remembers for one in self.slow], self.zeros)

    @cached_property
    def _carried(self) -> list[FloatArray]:
        """What becomes of the filter's state in the pause before each run, shape (2·sections, 2·sections).

        It goes on as the processes do without a push: so nothing is taken for seen.
        """
        free = without_innovations(self._sections)
        after: dict[int, FloatArray] = {}
        for _, missing in self._rows.runs:
            if missing not in after:
                after[missing] = np.linalg.matrix_power(free, missing)
        return [after[missing] for _, missing in self._rows.runs]

    @cached_property
    def _jumps(self) -> list[tuple[slice, FloatArray, float]]:
        """What a jump of the level in a pause does to the rows after it: those, the whitened jump, 1 + its power.

        The level after a pause is known as far as the processes let it be. A jump of variance V, in units of that of an
        innovation, with the whitened form r adds V·r·rᵀ to the covariance; the root of its inverse is applied.
        """
        runs = self._rows.runs
        if not self.slow or len(runs) < 2:
            return []
        longest = max(rows.stop - rows.start for rows, _ in runs)
        step: FloatArray = scipy.signal.sosfilt(self._sections, np.ones(longest))
        small = np.flatnonzero(np.abs(step) < _FORGOTTEN)
        reach = int(small[0]) if small.size else longest
        jumps = []
        for whole, missing in runs[1:]:
            rows = slice(whole.start, min(whole.stop, whole.start + reach))
            response = step[: rows.stop - rows.start] * self.weight[rows]
            variance = sum(_wandered(one, missing) for one in self.slow) / self.innovation**2
            power = 1.0 + variance * float(response @ response) / self.usual**2
            if power > 1.0:
                jumps.append((rows, response, power))
        return jumps


@dataclass(frozen=True)
class _Rows:
    """What of the rows that count a filter must know, whatever its processes."""

    interval_s: float
    weight: FloatArray
    time_s: FloatArray

    @cached_property
    def counted(self) -> IntArray:
        """The rows that count."""
        return np.flatnonzero(self.weight > 0.0)

    @cached_property
    def log_determinant(self) -> float:
        """That of their variances, relative to each other."""
        return -2.0 * float(np.log(self.weight[self.counted]).sum())

    @cached_property
    def bridges(self) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
        """Rows that do not count, and those between which a line takes their place, for the filter remembers them."""
        good, spoilt = self.counted, np.flatnonzero(self.weight <= 0.0)
        if good.size == 0:
            return spoilt[:0], good, good, np.zeros(0)
        place = np.searchsorted(good, spoilt)
        before, after = good[np.maximum(place - 1, 0)], good[np.minimum(place, good.size - 1)]
        share = (spoilt - before) / np.maximum(after - before, 1)
        return spoilt, before, after, np.clip(share, 0.0, 1.0)

    @cached_property
    def runs(self) -> list[tuple[slice, int]]:
        """Rows between pauses, with the samples that are missing before them."""
        good = self.counted
        if good.size == 0:
            return []
        before, after = good[:-1], good[1:]
        missing = after - before - 1
        if self.time_s.size:
            missing = np.rint((self.time_s[after] - self.time_s[before]) / self.interval_s).astype(np.int64) - 1
        long = missing > _BRIDGED
        starts = [int(good[0]), *after[long].tolist()]
        stops = [*(before[long] + 1).tolist(), int(good[-1]) + 1]
        rows = [slice(first, stop) for first, stop in zip(starts, stops, strict=True)]
        return list(zip(rows, [0, *missing[long].tolist()], strict=True))


def _wandered(process: Slow, samples: int) -> float:
    """Variance of what a process has gained by chance over so many samples."""
    if process.remembers >= 1.0:
        return float(process.drive * samples)
    return float(process.drive * (1.0 - process.remembers ** (2 * samples)) / (1.0 - process.remembers**2))


@lru_cache(maxsize=256)
def _zeros(slow: tuple[Slow, ...]) -> tuple[float, ...]:
    """The ψ of the innovations' filter: by bisection, in the logarithm of −u, between the poles and beyond the last."""
    poles = np.array([(1.0 - one.remembers) ** 2 / one.remembers for one in slow])
    drives = np.array([one.drive / one.remembers for one in slow])
    if len(slow) == 1:
        found = poles + drives
        return tuple((1.0 + found / 2.0 - np.sqrt(found + found * found / 4.0)).tolist())
    order = np.argsort(poles)
    poles, drives = poles[order], drives[order]
    low, high = poles.copy(), np.append(poles[1:], poles[-1:] + drives.sum() + 1e-300)
    for _ in range(200):
        middle = _between(low, high)
        # just beyond a pole the sum is −∞, and it grows towards the next
        below = 1.0 + np.sum(drives / (poles - middle[:, None]), axis=1) < 0.0
        closer = np.where(below, low < middle, high > middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
        if not closer.any():
            break
    found = 0.5 * (low + high)
    zeros = 1.0 + found / 2.0 - np.sqrt(found + found * found / 4.0)
    ordered = np.empty_like(zeros)
    ordered[order] = zeros
    return tuple(ordered.tolist())


def _between(low: FloatArray, high: FloatArray) -> FloatArray:
    """Half way, in ratios where there are any."""
    below = np.where(high > 1e-24, high * 1e-3, high / 2)
    return np.where(low > 0.0, np.sqrt(low * high), below)


def _sections(poles: Sequence[float], zeros: Sequence[float]) -> FloatArray:
    """Second-order sections (m, 6) of Π(1 − φ_i·B)/(1 − ψ_i·B), neighbours together."""
    pairs = sorted(zip(poles, zeros, strict=True))
    rows = []
    for i in range(0, len(pairs), 2):
        (a, b), (c, d) = pairs[i], pairs[i + 1] if i + 1 < len(pairs) else (0.0, 0.0)
        rows.append([1.0, -(a + c), a * c, 1.0, -(b + d), b * d])
    return np.array(rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class Noisy:
    """What was found: its gain in twice the log likelihood, its size, and the error of the size's logarithm.

    The size of a wandering bias is in units of the white noise's deviation; that of noise that grows is the growth of
    its variance up to full rate. `whitener` is the one with it; `rivals` are the losses with
    another process in its place.
    """

    effect: str
    gain: float
    size: float
    log_error: float
    whitener: Whitener
    rivals: Mapping[str, float] = field(default_factory=dict)
