"""The noise of a recording, and the filter that whitens it.

White noise σ² plus slow processes s_i, each of which keeps the share φ_i of its value from sample to sample and is
driven by q_i·σ² (a random walk has φ = 1; flicker is a handful of processes, one to less than a decade), has the
spectrum

    σ²·(1 + Σ q_i/((1 − φ_i)² + φ_i·u)),   u = 2 − 2·cos(2πf·dt),

a ratio of polynomials in u whose zeros lie, one each, between its poles. So the noise is the filter
Π(1 − ψ_j·B)/(1 − φ_i·B) of its innovations, and the inverse, a chain of first-order sections, whitens it (Harvey,
Forecasting, structural time series models, 1989, ch. 2; Box & Jenkins, Time series analysis, ch. 4). Its determinant
is one: the likelihood of a model is that of its innovations.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
import scipy.optimize
import scipy.signal

from benchctl_instruments.arrays import FloatArray, IntArray

_FLICKER_RATIO = 5.0
"""Ratio of the time constants of the processes that make flicker; its spectrum then ripples by less than 2 percent."""
_SHAPED, _SLOWEST, _SHAPED_FROM = 5, 16, 1e-4
"""Number of fastest processes with fitted sizes, number of all, lowest frequency of the fit over the sampling rate."""
_FORGOTTEN = 1e-3
_BRIDGED = 3
"""Largest number of consecutive rows without weight that are bridged; more of them are a pause."""
_ALIKE = 4
"""Minimum number of runs of equal length that are filtered together; the response to a state costs an extra call."""
_TOGETHER = 1 << 18
"""Number of rows of a column that are filtered at once; more would only take memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slow:
    """One slow process: the share kept from sample to sample, and its drive over the white noise's variance."""

    remembers: float
    drive: float


def walk(per_root_s: float, interval_s: float) -> tuple[Slow, ...]:
    """Return a random walk of `per_root_s` [1/√s], in units of the standard deviation of the white noise."""
    return (Slow(remembers=1.0, drive=per_root_s**2 * interval_s),)


def flicker(rms_per_decade: float, interval_s: float, lasts_s: float) -> tuple[Slow, ...]:
    """Return noise with the same power in every decade, down to one over ten times `lasts_s`, in the same units.

    Its density is accurate to 3 % up to a tenth of the sampling rate, to 6 % up to four tenths.
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
    """Fit variances of the fastest processes that, with equal ones for the others, give the two-sided density 1/f.

    Sampling aliases power from above half its rate, so equal variances would give too little power below it.
    """
    frequency = np.geomspace(_SHAPED_FROM, 0.5, 1000)
    lag = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency)
    remembers = np.exp(-(_FLICKER_RATIO ** -np.arange(_SLOWEST, dtype=np.float64)))
    density = (1.0 - remembers**2) / ((1.0 - remembers) ** 2 + remembers * lag[:, None]) * frequency[:, None]
    rest = 1.0 - 2.0 * math.log(_FLICKER_RATIO) * density[:, _SHAPED:].sum(axis=1)
    return tuple(scipy.optimize.nnls(density[:, :_SHAPED], rest)[0].tolist())


@dataclass(frozen=True, kw_only=True)
class Whitener:
    """Filters columns of data or of predictions, shape (n,) or (k, n), so that their noise is white and of equal size.

    `slow` are the processes in addition to the white noise; `weight` (n,) is the inverse of a row's relative standard
    deviation, 0 for rows that do not count; `time_s` (n,) shows where rows are missing, and may be omitted if none are.
    """

    interval_s: float
    weight: FloatArray
    slow: tuple[Slow, ...] = ()
    time_s: FloatArray = field(default_factory=lambda: np.zeros(0))

    def with_slow(self, slow: tuple[Slow, ...]) -> Whitener:
        """Return a whitener of the same rows with other slow processes."""
        other = replace(self, slow=slow)
        other.__dict__["_rows"] = self._rows  # depends on the rows only, so it is computed once
        return other

    @cached_property
    def zeros(self) -> tuple[float, ...]:
        """The ψ_j, one for each process."""
        return _zeros(self.slow)

    @cached_property
    def innovation(self) -> float:
        """Standard deviation of an innovation over that of the white noise."""
        ratio = 1.0
        for process, zero in zip(self.slow, self.zeros, strict=True):
            ratio *= process.remembers / zero
        return math.sqrt(ratio)

    @cached_property
    def usual(self) -> float:
        """The weight of a typical row, to whose white noise the drives of the processes refer."""
        counted = self.weight[self._rows.counted]
        return float(np.median(counted)) if counted.size else 1.0

    @cached_property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the noise's covariance, without the variance of the innovations."""
        jumps = sum(math.log(power) for _, _, power in self._jumps)
        return jumps + self._rows.log_determinant

    def __call__(self, column: FloatArray) -> FloatArray:
        """Return the whitened column, shape (n,), or several, shape (k, n)."""
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
        """Maps of the filter's state over the pause before each run, shape (2·sections, 2·sections).

        The state evolves as the processes do without a drive, so that the pause counts as not measured.
        """
        free = without_innovations(self._sections)
        after: dict[int, FloatArray] = {}
        for _, missing in self._rows.runs:
            if missing not in after:
                after[missing] = np.linalg.matrix_power(free, missing)
        return [after[missing] for _, missing in self._rows.runs]

    @cached_property
    def _jumps(self) -> list[tuple[slice, FloatArray, float]]:
        """Effect of the unknown level after each pause: the rows, the whitened step response, 1 + its power.

        The level after a pause is known as far as the processes determine it. A jump of variance V, relative to that of
        an innovation, with the whitened form r adds V·r·rᵀ to the covariance; the root of its inverse is applied.
        """
        runs = self._rows.runs
        if not self.slow or len(runs) < 2:
            return []
        longest = max(rows.stop - rows.start for rows, _ in runs)
        step: FloatArray = scipy.signal.sosfilt(self._sections, np.ones(longest))
        small = np.flatnonzero(np.abs(step) < _FORGOTTEN)
        reach = int(small[0]) if small.size else longest
        jumps = []
        for run, missing in runs[1:]:
            rows = slice(run.start, min(run.stop, run.start + reach))
            response = step[: rows.stop - rows.start] * self.weight[rows]
            variance = sum(_wandered(one, missing) for one in self.slow) / self.innovation**2
            power = 1.0 + variance * float(response @ response) / self.usual**2
            if power > 1.0:
                jumps.append((rows, response, power))
        return jumps


@dataclass(frozen=True)
class _Rows:
    """Properties of the counted rows that a filter needs, independent of its processes."""

    interval_s: float
    weight: FloatArray
    time_s: FloatArray

    @cached_property
    def counted(self) -> IntArray:
        """The rows that count."""
        return np.flatnonzero(self.weight > 0.0)

    @cached_property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the rows' relative variances."""
        return -2.0 * float(np.log(self.weight[self.counted]).sum())

    @cached_property
    def bridges(self) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
        """Rows that do not count, and the rows between which they are interpolated, since the filter has a memory.

        If many rows are bridged in this way, each has the value before it instead: a value interpolated to the next one
        would foretell it.
        """
        good, spoilt = self.counted, np.flatnonzero(self.weight <= 0.0)
        if good.size == 0:
            return spoilt[:0], good, good, np.zeros(0)
        place = np.searchsorted(good, spoilt)
        before, after = good[np.maximum(place - 1, 0)], good[np.minimum(place, good.size - 1)]
        share = (spoilt - before) / np.maximum(after - before, 1)
        bridged = after - before <= _BRIDGED + 1
        if 2 * np.count_nonzero(bridged) > good.size:
            share[bridged] = 0.0
        return spoilt, before, after, np.clip(share, 0.0, 1.0)

    @cached_property
    def runs(self) -> list[tuple[slice, int]]:
        """Rows between pauses, each with the number of samples that are missing before them."""
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
    """Return the variance that a process gains over so many samples."""
    if process.remembers >= 1.0:
        return float(process.drive * samples)
    return float(process.drive * (1.0 - process.remembers ** (2 * samples)) / (1.0 - process.remembers**2))


@lru_cache(maxsize=256)
def _zeros(slow: tuple[Slow, ...]) -> tuple[float, ...]:
    """Return the ψ of the innovations' filter: by bisection in the logarithm of −u, between and beyond the poles."""
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
        # just above a pole the sum is −∞, and it increases towards the next
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
    """Return the geometric mean, or a thousandth of `high` (half if tiny) if `low` is not positive."""
    below = np.where(high > 1e-24, high * 1e-3, high / 2)
    return np.where(low > 0.0, np.sqrt(low * high), below)


def _sections(poles: Sequence[float], zeros: Sequence[float]) -> FloatArray:
    """Return second-order sections (m, 6) of Π(1 − φ_i·B)/(1 − ψ_i·B), with neighbours paired."""
    pairs = sorted(zip(poles, zeros, strict=True))
    rows = []
    for i in range(0, len(pairs), 2):
        (a, b), (c, d) = pairs[i], pairs[i + 1] if i + 1 < len(pairs) else (0.0, 0.0)
        rows.append([1.0, -(a + c), a * c, 1.0, -(b + d), b * d])
    return np.array(rows)


def filtered(
    sections: FloatArray, values: FloatArray, runs: Sequence[slice], carried: Sequence[FloatArray]
) -> FloatArray:
    """Filter values (k, n) by second-order sections (m, 6), run by run; 0 outside the runs.

    A call for each run costs more than the filtering if there are thousands of short runs. The filter is linear: runs
    of equal length are filtered together as if each began at rest, and the response to the state before it is added.
    `carried` are the matrices that map the filter's state over the pause before each run, shape (2·m, 2·m).
    """
    white = np.zeros_like(values)
    free: dict[int, tuple[FloatArray, FloatArray]] = {}
    ends: dict[int, FloatArray] = {}
    for length, alike in _of_one_length(runs):
        if length not in free:
            free[length] = _free(sections, length)
        passed, states = _passed(sections, np.stack([values[:, runs[i]] for i in alike], axis=1))
        for place, i in enumerate(alike):
            white[:, runs[i]] = passed[:, place]
            ends[i] = states[:, :, place]
    state = np.zeros((2 * len(sections), len(values)))
    for i, (rows, through) in enumerate(zip(runs, carried, strict=True)):
        state = through @ state
        if i in ends:
            response, onward = free[rows.stop - rows.start]
            white[:, rows] += (response @ state).T
            state = onward @ state + ends[i]
        else:
            white[:, rows], state = _passed(sections, values[:, rows], state)
    return white


def without_innovations(sections: FloatArray) -> FloatArray:
    """Return the map of the sections' state over a step with zero output, shape (2·m, 2·m).

    The input of each section then follows from its state alone.
    """
    columns = []
    for state in np.eye(2 * len(sections)):
        left, after = 0.0, np.empty((len(sections), 2))
        for k in range(len(sections) - 1, -1, -1):
            _, b1, b2, _, a1, a2 = sections[k]
            entered = left - state[2 * k]
            after[k] = b1 * entered - a1 * left + state[2 * k + 1], b2 * entered - a2 * left
            left = entered
        columns.append(after.ravel())
    return np.stack(columns, axis=1)


def _of_one_length(runs: Sequence[slice]) -> Iterator[tuple[int, list[int]]]:
    """Yield the indices of runs that share a length, and that length; limited to a number of rows at once."""
    places: dict[int, list[int]] = {}
    for i, rows in enumerate(runs):
        places.setdefault(rows.stop - rows.start, []).append(i)
    for length, alike in places.items():
        many = max(_TOGETHER // length, _ALIKE)
        for first in range(0, len(alike) if len(alike) >= _ALIKE else 0, many):
            yield length, alike[first : first + many]


def _free(sections: FloatArray, length: int) -> tuple[FloatArray, FloatArray]:
    """Return the output of each state without input over `length` rows, (length, 2·m), and the map to the end state."""
    states = np.eye(2 * len(sections))
    response, onward = _passed(sections, np.zeros((len(states), length)), states)
    return response.T, onward


def _passed(sections: FloatArray, values: FloatArray, state: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Filter values (k, …, n) by sections from a state, shape (2·m, k, …), or from rest; also return the end state."""
    count, others = len(sections), values.shape[:-1]
    begun = np.zeros((2 * count, *others)) if state is None else state
    passed, ended = scipy.signal.sosfilt(sections, values, zi=np.moveaxis(begun.reshape(count, 2, *others), 1, -1))
    return passed, np.moveaxis(ended, -1, 1).reshape(2 * count, *others)


@dataclass(frozen=True, slots=True, kw_only=True)
class Noisy:
    """A finding about the noise: its gain in twice the log likelihood, its size, and the error of the size's logarithm.

    The size of a wandering bias is in units of the white noise's standard deviation; that of growing noise is the
    growth of its variance up to full rate. `whitener` includes it; `rivals` are the losses in gain with another process
    in its place.
    """

    effect: str
    gain: float
    size: float
    log_error: float
    whitener: Whitener
    rivals: Mapping[str, float] = field(default_factory=dict)
