"""A wandering bias: which slow process the data require in addition to the white noise, and its size.

The likelihoods are compared with everything refitted that the current model can absorb: a wandering bias must not
explain what a refitted temperature coefficient would. A search over sizes uses means of many samples, which contain all
that is slow; the result is then measured on the samples themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import minimize_scalar

from benchctl.estimation.fit import Fit, inverse, whitened_columns
from benchctl.estimation.noise import Noisy, Slow, Whitener, flicker, walk
from benchctl.estimation.problem import Problem
from benchctl.side_by_side import shared_out
from benchctl.signals.blocks import gram
from benchctl_instruments.arrays import BoolArray, FloatArray

Process = Callable[[float, float, float], tuple[Slow, ...]]

PROCESSES: Mapping[str, Process] = {
    "bias_random_walk": lambda size, interval_s, _lasts_s: walk(size, interval_s),
    "flicker_noise": flicker,
}
"""Processes from a size over the white noise's deviation, the sampling interval and the length of the recording."""

_BLOCK_S = 0.2
_MOST_ROWS = 1_500_000
"""Above this number of samples, means of a few are used; they keep anything slower than some hundredths of a second."""
_SIZES = np.geomspace(1e-4, 10.0, 16)
_NEAR = math.log(1.15)
_TOLERANCE = 0.02
_STEPS, _FORESEEN = 16, 5
"""Maximum number of parabolas; a gain may still grow by at most this many times the last one's increase.

Means of many samples that contain hardly any white noise do not determine the size, so the start may be far off.
"""
_FEWEST = 50
_BELIED = 10.0
"""Loss of twice the log likelihood at rest, per step and one more, above which a process is rejected.

A step's own level is fitted to it while a process predicts it: that alone is worth a few."""


def wandering(
    problem: Problem, whitener: Whitener, fitted: Fit, *, least_gain: float, rival: float = -math.inf
) -> list[Noisy]:
    """Return the processes that gain more than `least_gain` over white noise on the fitted steps.

    Processes that certainly gain less than a `rival` are not measured to the end; if all do, the list is empty.
    """
    kinds = [name for name in PROCESSES if name in problem.noises]
    if not kinds:
        return []
    columns = np.vstack([fitted.residual, fitted.raw_derivatives.T]).T
    usable = np.asarray(whitener.weight > 0.0, np.float64)
    blocks = _Blocks(problem, usable, columns, fitted.fitted, max(1, round(_BLOCK_S / problem.interval_s)))
    best = shared_out(lambda name: blocks.best(PROCESSES[name], least_gain), kinds)
    sized = {name: size for name, (gain, size) in zip(kinds, best, strict=True) if gain > least_gain}

    def measured(name: str) -> Noisy:
        return _measured(problem, whitener, fitted, columns, name, sized[name], rival)

    found = list(shared_out(measured, list(sized)))
    if all(one.gain <= rival for one in found):
        return []
    return [one for one in found if one.gain > least_gain]


def _measured(
    problem: Problem,
    whitener: Whitener,
    fitted: Fit,
    columns: FloatArray,
    name: str,
    size: float,
    rival: float,
) -> Noisy:
    """Measure the gain and the size on the samples themselves, by parabolas through three sizes."""
    duration_s = float(problem.time_s[-1] - problem.time_s[0])
    rows = fitted.fitted[problem.step]
    together = -(-rows.size // _MOST_ROWS)
    means = _Means(problem, whitener.weight, columns, fitted.fitted, together) if together > 1 else None

    def with_size(log_size: float) -> Whitener:
        return whitener.with_slow(PROCESSES[name](math.exp(log_size), problem.interval_s, duration_s))

    def at(log_size: float) -> float:
        if means is not None:
            return means.deviance(PROCESSES[name], math.exp(log_size))
        return _deviance(with_size(log_size), columns, rows)

    bare = _deviance(whitener.with_slow(()), columns, rows) if means is None else means.deviance(PROCESSES[name], 0.0)
    middle = math.log(size)
    for _ in range(_STEPS):
        low, here, high = (at(middle + k * _NEAR) for k in (-1, 0, 1))
        curvature = max((low - 2.0 * here + high) / _NEAR**2, 1e-6)
        step = min(max(0.5 * (low - high) / (curvature * _NEAR), -2.0 * _NEAR), 2.0 * _NEAR)
        middle += step
        if abs(step) < _NEAR or bare - here + _FORESEEN * 2.0 * abs(low - high) < rival:
            break
    best, other = at(middle), with_size(middle)
    resting = sum(kind == "static" for kind in problem.step_kinds)
    belied = _gain_at_rest(problem, other, fitted) < -_BELIED * (1 + resting)
    return Noisy(
        effect=name,
        gain=0.0 if belied else bare - best,
        size=math.exp(middle) / other.usual,
        log_error=math.sqrt(2.0 / curvature),
        whitener=other,
    )


def _gain_at_rest(problem: Problem, whitener: Whitener, fitted: Fit) -> float:
    """Return the gain of the process while the table rests, over a separate level for each step.

    A wandering bias also wanders at rest. An effect that only resembles it because it follows the motion does not: then
    the process predicts rest worse than no process.
    """
    white = whitener(fitted.residual)
    process = level = rows = 0.0
    for number, kind in enumerate(problem.step_kinds):
        if kind != "static" or not fitted.fitted[number]:
            continue
        # the filter's state at the start of a step depends on the rows before it
        first, last = np.searchsorted(problem.step, [number, number + 1]).tolist()
        first += (last - first) // 4
        inside = first + np.flatnonzero(whitener.weight[first:last] > 0.0)
        if inside.size < _FEWEST:
            continue
        alone = fitted.residual[inside]
        process += float(np.sum((white[inside] / whitener.weight[inside]) ** 2))
        level += float(np.sum((alone - alone.mean()) ** 2))
        rows += inside.size
    return rows * math.log(level / process) if process > 0.0 and level > 0.0 else 0.0


def _deviance(whitener: Whitener, columns: FloatArray, rows: BoolArray) -> float:
    """Return minus twice the log likelihood of the first column on some rows, with the others refitted to it."""
    count = float((whitener.weight[rows] > 0.0).sum())
    white = whitened_columns(whitener, columns)
    white *= rows[:, None]
    return count * math.log(_left(white)) + whitener.log_determinant


def _left(columns: FloatArray) -> float:
    """Return the sum of squares of the first column after projection on the others."""
    products = gram(columns)
    gradient = products[1:, 0]
    return max(float(products[0, 0] - gradient @ inverse(products[1:, 1:]) @ gradient), 1e-300)


class _Blocks:
    """Means of residual and derivatives over many samples with `weight` (n,); likelihoods are those of the means.

    The weights are the inverse of the samples' relative white noise.
    """

    def __init__(
        self, problem: Problem, weight: FloatArray, columns: FloatArray, fitted: BoolArray, samples: int
    ) -> None:
        self._samples = samples
        self._interval_s = self._samples * problem.interval_s
        self._lasts_s = float(problem.time_s[-1] - problem.time_s[0])
        starts = [
            np.arange(part.start, part.stop - self._samples + 1, self._samples)
            for part in problem.stretches
            if part.stop - part.start >= self._samples
        ]
        self._first = np.concatenate(starts) if starts else np.zeros(0, np.int64)
        power = weight**2
        self._power = self._summed(power)
        means = list(shared_out(lambda one: self._summed(np.where(weight > 0.0, one * power, 0.0)), columns.T))
        self._columns = (np.stack(means) / np.where(self._power > 0.0, self._power, 1.0)).T
        self._fitted = fitted[problem.step[self._first]]
        self._whitener = Whitener(
            interval_s=self._interval_s,
            weight=np.sqrt(self._power / self._samples),
            time_s=problem.time_s[self._first],
        )

    def _summed(self, values: FloatArray) -> FloatArray:
        """Return the sums over the samples of each mean."""
        if not self._first.size:
            return np.zeros(0)
        ends = np.stack([self._first, self._first + self._samples], axis=1).ravel()
        sums: FloatArray = np.add.reduceat(np.append(values, 0.0), ends)[::2]
        return sums

    def best(self, process: Process, least_gain: float) -> tuple[float, float]:
        """Return the largest gain, and its size over the standard deviation of a sample's white noise.

        Sizes first differ by a factor of four, near the best by two; the search is refined only if the gain is near
        `least_gain`.
        """
        if not self._fitted.any():
            return 0.0, float(_SIZES[0])
        deviances = {place: self.deviance(process, float(_SIZES[place])) for place in range(0, _SIZES.size, 2)}
        first = min(deviances, key=deviances.__getitem__)
        for place in (first - 1, first + 1):
            if 0 <= place < _SIZES.size:
                deviances[place] = self.deviance(process, float(_SIZES[place]))
        place = min(deviances, key=deviances.__getitem__)
        bare = self.deviance(process, 0.0)
        if bare - deviances[place] < 0.5 * least_gain:
            return 0.0, float(_SIZES[place])
        around = np.log(_SIZES[[max(place - 1, 0), min(place + 1, _SIZES.size - 1)]])
        found = minimize_scalar(
            lambda log_size: self.deviance(process, math.exp(log_size)),
            bounds=tuple(around.tolist()),
            method="bounded",
            options={"xatol": _TOLERANCE},
        )
        return bare - float(found.fun), math.exp(float(found.x))

    def deviance(self, process: Process, size: float) -> float:
        """Return minus twice the log likelihood with a process of this size; 0 for none."""
        # the white noise of a mean is smaller by the root of the samples, so the relative size of the process is larger
        relative = size * math.sqrt(self._samples)
        slow = process(relative, self._interval_s, self._lasts_s) if size > 0.0 else ()
        whitener = self._whitener.with_slow(slow)
        white = whitened_columns(whitener, self._columns)
        white *= self._fitted[:, None]
        return self._likelihood(_left(white)) + whitener.log_determinant

    def _likelihood(self, left: float) -> float:
        """Return minus twice the log likelihood from the residual sum of squares of the whitened means."""
        return float(self._fitted.sum()) * math.log(left)


class _Means(_Blocks):
    """Means over so few samples that a process is constant in each; likelihoods are those of the samples."""

    def __init__(
        self, problem: Problem, weight: FloatArray, columns: FloatArray, fitted: BoolArray, samples: int
    ) -> None:
        super().__init__(problem, weight, columns, fitted, samples)
        squares = self._summed((columns[:, 0] * weight) ** 2) - self._power * self._columns[:, 0] ** 2
        self._within = float(squares[self._fitted].sum())
        self._rows = float(self._summed(np.asarray(weight > 0.0, np.float64))[self._fitted].sum())

    def _likelihood(self, left: float) -> float:
        return self._rows * math.log(self._within + self._samples * left)
