"""The table's ripple: true motion that repeats with the angle, such as the cogging of a motor.

At high rates its lines lie beyond the pass band of a filter that is narrow enough to reject the encoder's noise, but
the gyro still senses what the filter removes. It is too small to be detected within a second, but it accumulates over a
recording: ten micrometres of cogging look like an encoder error. Because it is locked to the angle, it can be estimated
from the complete recording with very little noise, and bypass the filter.

The torque that shakes the table is locked to the angle; the resulting motion is delayed by the servo. Over the angle
this is a shift proportional to the rate, with opposite signs for the two directions of rotation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from benchctl.recordings.runs import holding
from benchctl.signals.binning import line_scores
from benchctl.signals.rate import NARROW, differentiator, edges_hz, filtered
from benchctl_instruments.arrays import FloatArray, IntArray

_MOST_ORDERS = 6
_HIGHEST_ORDER = 100_000
_SAFE = 14.0
"""Margin, in twice the log likelihood, over the best of all orders by chance; false alarm probability 0.001."""

_SEEN = 0.03
"""Minimum share of a wave that the narrow filter removes for it to be searched for; a smaller loss is negligible."""

_BELOW_SAMPLING = 0.4
"""Share of the sampling rate up to which a line can be motion; faster ones are errors of the encoder's grating."""

_RATHER = 0.5
"""At one rate a slow and a fast line can look the same: the slow one is chosen if it explains at least half as much."""

_EXACT_DEG = 1e-7
"""Standard deviation below which angles contain only rounding errors and no encoder noise."""

_LEVEL_S = 0.2
_STEADY = 0.003
"""A rate is steady if it changes by less than this share within a filter's reach."""

_LAG_ROUNDS = 3

_STEPS = 4000
"""Number of bins for the angle that the table turns from row to row."""

_SUMMED = 2000
"""Orders of motion whose power is summed over all rates; higher ones are assumed to spread over the complete band."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ripple:
    """Σ a·cos(m·θ) + b·sin(m·θ) [deg] over `orders` m, shape (k,), with `cosines` a and `sines` b [deg].

    θ is the angle `lag_s` earlier (later if negative): see `lagging`.
    """

    orders: tuple[int, ...] = ()
    cosines: tuple[float, ...] = ()
    sines: tuple[float, ...] = ()
    lag_s: float = 0.0

    def lagging(self, angle_deg: FloatArray, sample_rate_hz: float) -> FloatArray:
        """Return equidistant angles of a stretch as they were `lag_s` earlier, shape (n,)."""
        return lagging(angle_deg, self.lag_s * sample_rate_hz)

    def angle_deg(self, angle_deg: FloatArray) -> FloatArray:
        """Return the ripple's contribution to the angle, at lagging angles of the encoder, shape (n,)."""
        return self._sum(angle_deg, 0)

    def slope(self, angle_deg: FloatArray) -> FloatArray:
        """Return its derivative by the angle, shape (n,), dimensionless."""
        return self._sum(angle_deg, 1)

    def bend_per_deg(self, angle_deg: FloatArray) -> FloatArray:
        """Return its second derivative by the angle [1/deg], shape (n,)."""
        return self._sum(angle_deg, 2)

    def _sum(self, angle_deg: FloatArray, derivative: int) -> FloatArray:
        total = np.zeros_like(angle_deg)
        for order, a, b in zip(self.orders, self.cosines, self.sines, strict=True):
            turned = np.radians(order * angle_deg + 90.0 * derivative)
            total += math.radians(order) ** derivative * (a * np.cos(turned) + b * np.sin(turned))
        return total


NO_RIPPLE = Ripple()


def lagging(angle_deg: FloatArray, rows: float) -> FloatArray:
    """Return equidistant angles as they were `rows` rows earlier, extrapolated by their rate of change, shape (n,)."""
    return angle_deg if rows == 0.0 or angle_deg.size < 2 else np.asarray(angle_deg - rows * np.gradient(angle_deg))


def ripple_of(angles_deg: Sequence[FloatArray], sample_rate_hz: float) -> Ripple:
    """Estimate the ripple of a table from its encoder's equidistant, unwrapped angles, one array per gap-free stretch.

    The search uses only parts in which the table turns steadily, and only lines that leave the narrow filter's pass
    band there, the strongest first. A line is kept if its false alarm probability is below 0.001. An encoder error that
    repeats as slowly is included if present: the encoder alone cannot distinguish the two. An error that repeats faster
    than any motion is fitted too, so that it does not mask the others, and then discarded.
    """
    edges = edges_hz(NARROW, sample_rate_hz)
    rate_filter = differentiator(sample_rate_hz, *edges, 1)
    window = max(3, int(_LEVEL_S * sample_rate_hz))
    runs = [run for angle in angles_deg if angle.size > 1 for run in _steady(angle, rate_filter, window)]
    if not runs:
        return NO_RIPPLE
    search = _Search(runs, differentiator(sample_rate_hz, *edges, 0))
    ripple = NO_RIPPLE
    while len(ripple.orders) < _MOST_ORDERS:
        order = search.strongest(ripple)
        if order is None:
            break
        ripple = search.fitted((*ripple.orders, order))
    return search.motion_of(ripple, sample_rate_hz)


def _steady(angle_deg: FloatArray, rate_filter: FloatArray, window: int) -> list[FloatArray]:
    """Return the parts of a stretch with a constant rate, each longer than four reaches of a filter."""
    rate = uniform_filter1d(filtered(angle_deg, rate_filter), window)
    half = rate_filter.size // 2
    reach = 2 * (half + window) + 1
    change = maximum_filter1d(rate, reach) - minimum_filter1d(rate, reach)
    return [
        angle_deg[run] - 360.0 * np.floor(angle_deg[run.start] / 360.0)
        for run in holding(change < _STEADY * np.abs(rate))
        if run.stop - run.start > 4 * half
    ]


class _Search:
    """The signal above a filter's band while the table turns steadily, and the waves that are detectable in it."""

    def __init__(self, runs: Sequence[FloatArray], smooth: FloatArray) -> None:
        self._runs = runs
        self._kernel = -smooth
        self._half = half = smooth.size // 2
        self._kernel[half] += 1.0
        self._fast = np.concatenate([self._above(run) for run in runs])
        turned = [np.abs(np.radians(run[2 * half :] - run[: -2 * half])) / (2 * half) for run in runs]
        self._step_rad = np.concatenate(turned)
        self._phase: FloatArray = np.linspace(0.0, np.pi, 2001)
        waves = np.cos(np.outer(self._phase, np.arange(1, half + 1)))
        self._gain = np.abs(self._kernel[half] + 2.0 * waves @ self._kernel[half + 1 :])
        fastest = max(float(self._step_rad.max()), 1e-9)
        lowest = math.ceil(float(self._phase[int(np.argmax(self._gain > _SEEN))]) / fastest)
        self.highest_of_motion = math.floor(2.0 * np.pi * _BELOW_SAMPLING / fastest)
        self._orders: IntArray = np.arange(lowest, _HIGHEST_ORDER + 1)

    def strongest(self, ripple: Ripple) -> int | None:
        """Return the order whose wave explains most of the residual of a ripple; None if none exceeds chance."""
        left = self._fast - np.concatenate([self._above(ripple.angle_deg(run)) for run in self._runs])
        # white noise of the encoder, of which the filter removes its share
        variance = float(np.mean(left**2)) / float(np.mean(self._gain**2))
        if self._orders.size == 0 or variance < _EXACT_DEG**2:
            return None
        ends = np.cumsum([run.size - 2 * self._half for run in self._runs])[:-1]
        back = np.concatenate([np.convolve(part, self._kernel) for part in np.split(left, ends)])
        scores = line_scores(back, np.concatenate(self._runs), int(self._orders[-1]))[self._orders]
        gain = np.abs(scores) ** 2 / (self._powers() * variance)
        gain[np.isin(self._orders, ripple.orders)] = 0.0
        best, motion = int(np.argmax(gain)), int(np.argmax(gain * (self._orders <= self.highest_of_motion)))
        if gain[motion] > _RATHER * gain[best]:
            best = motion
        return int(self._orders[best]) if gain[best] > 2.0 * math.log(gain.size) + _SAFE else None

    def motion_of(self, ripple: Ripple, sample_rate_hz: float) -> Ripple:
        """Return the orders of a ripple that can be motion, with the lag if it is significant."""
        kept = self._motion(ripple)
        rows = 0.0
        for _ in range(_LAG_ROUNDS if kept.orders else 0):
            waves, sizes = self._waves(ripple.orders, rows)
            at = [lagging(run, rows) for run in self._runs]
            by_row = [-np.gradient(run) * kept.slope(one) for run, one in zip(self._runs, at, strict=True)]
            column = np.concatenate([self._above(one) for one in by_row])
            left, power = self._fast - waves @ sizes, max(float(column @ column), 1e-300)
            pull = float(left @ column)
            if rows == 0.0 and pull**2 < _SAFE * power * float(np.mean(left**2)):
                break
            rows += pull / power
            kept = self._motion(self.fitted(ripple.orders, rows))
        return replace(kept, lag_s=rows / sample_rate_hz)

    def _motion(self, ripple: Ripple) -> Ripple:
        kept = [i for i, order in enumerate(ripple.orders) if order <= self.highest_of_motion]
        return Ripple(
            orders=tuple(ripple.orders[i] for i in kept),
            cosines=tuple(ripple.cosines[i] for i in kept),
            sines=tuple(ripple.sines[i] for i in kept),
        )

    def fitted(self, orders: tuple[int, ...], lag_rows: float = 0.0) -> Ripple:
        """Fit waves of some orders jointly; those of motion refer to angles `lag_rows` rows earlier."""
        sizes = self._waves(orders, lag_rows)[1].tolist()
        return Ripple(orders=orders, cosines=tuple(sizes[::2]), sines=tuple(sizes[1::2]))

    def _waves(self, orders: tuple[int, ...], lag_rows: float) -> tuple[FloatArray, FloatArray]:
        """Return the waves above the filter's band, shape (rows, 2 orders), and their amplitudes."""
        waves = []
        for order in orders:
            rows = lag_rows if order <= self.highest_of_motion else 0.0
            turned = [np.radians(order * lagging(run, rows)) for run in self._runs]
            waves.append(np.concatenate([self._above(np.cos(one)) for one in turned]))
            waves.append(np.concatenate([self._above(np.sin(one)) for one in turned]))
        columns = np.stack(waves, axis=1)
        return columns, np.linalg.lstsq(columns, self._fast, rcond=None)[0]

    def _above(self, values: FloatArray) -> FloatArray:
        """Return what the filter removes, without the rows near the ends."""
        return np.convolve(values, self._kernel, mode="valid")

    def _powers(self) -> FloatArray:
        """Return half the sum of the squared gains for waves of amplitude one, one value per order."""
        width = float(self._step_rad.max()) / _STEPS + 1e-15
        rows = np.bincount((self._step_rad / width).astype(np.int64))
        there = np.flatnonzero(rows)
        steps, squared = (there + 0.5) * width, self._gain**2
        # aliased at half the sampling rate, fast lines are spread over the complete band
        powers = np.full(self._orders.size, 0.5 * self._step_rad.size * float(np.mean(squared)))
        for place, order in enumerate(self._orders[self._orders <= self.highest_of_motion][:_SUMMED]):
            powers[place] = 0.5 * float(rows[there] @ np.interp(order * steps, self._phase, squared))
        return np.asarray(np.maximum(powers, 1e-300))
