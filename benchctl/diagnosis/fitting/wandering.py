"""A bias that wanders: which slow process the data demand beside the white noise, and how large it is.

The likelihood of each kind is compared with everything that the model in hand can follow fitted anew: what a wandering
bias explains must not be what a refitted temperature coefficient would. A search over sizes works on means of many
samples, which hold all that is slow; what is found is then measured on the samples themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from benchctl.diagnosis.fitting.fit import Fit, inverse, whitened_columns
from benchctl.diagnosis.fitting.noise import Slow, Whitener, flicker, walk
from benchctl.diagnosis.fitting.noisy import Noisy
from benchctl.diagnosis.problem import Problem

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Process = Callable[[float, float, float], tuple[Slow, ...]]

PROCESSES: Mapping[str, Process] = {
    "bias_random_walk": lambda size, interval_s, _lasts_s: walk(size, interval_s),
    "flicker_noise": flicker,
}
"""From a size over the deviation of the white noise, the time between samples and the length of the recording."""

_BLOCK_S = 0.2
_SIZES = np.geomspace(1e-4, 10.0, 16)
_NEAR = math.log(1.15)
_TOLERANCE = 0.02
_STEPS = 5
"""Parabolas at most: means of many samples hold less of what is fast, and may lead some way off."""
_FEWEST = 50
_BELIED = 10.0
"""Loss of twice the log likelihood at rest, for each step and one more, from which on a process is none.

A step's own level is fitted to it and a process foretells it: that alone is worth a few."""


def wandering(problem: Problem, whitener: Whitener, fitted: Fit, *, least_gain: float) -> list[Noisy]:
    """The processes that gain more than `least_gain` over white noise on the steps that a model was fitted to."""
    kinds = [name for name in PROCESSES if name in problem.noises]
    if not kinds:
        return []
    columns = np.column_stack([fitted.residual, fitted.raw_derivatives])
    blocks = _Blocks(problem, whitener, columns, fitted.fitted)
    found = []
    for name in kinds:
        gain, size = blocks.best(PROCESSES[name], least_gain)
        if gain > least_gain:
            found.append(_measured(problem, whitener, fitted, columns, name, size))
    return [one for one in found if one.gain > least_gain]


def _measured(problem: Problem, whitener: Whitener, fitted: Fit, columns: FloatArray, name: str, size: float) -> Noisy:
    """The gain and the size on the samples themselves, by parabolas through three sizes."""
    lasts_s = float(problem.time_s[-1] - problem.time_s[0])
    rows = fitted.fitted[problem.step]

    def at(log_size: float) -> tuple[float, Whitener]:
        other = whitener.beside(PROCESSES[name](math.exp(log_size), problem.interval_s, lasts_s))
        return _deviance(other, columns, rows), other

    without = _deviance(whitener.beside(()), columns, rows)
    middle = math.log(size)
    for _ in range(_STEPS):
        low, here, high = (at(middle + k * _NEAR)[0] for k in (-1, 0, 1))
        curvature = max((low - 2.0 * here + high) / _NEAR**2, 1e-6)
        step = min(max(0.5 * (low - high) / (curvature * _NEAR), -2.0 * _NEAR), 2.0 * _NEAR)
        middle += step
        if abs(step) < _NEAR:
            break
    best, other = at(middle)
    resting = sum(kind == "static" for kind in problem.step_kinds)
    belied = _gain_at_rest(problem, other, fitted) < -_BELIED * (1 + resting)
    return Noisy(
        effect=name,
        gain=0.0 if belied else without - best,
        size=math.exp(middle),
        log_error=math.sqrt(2.0 / curvature),
        whitener=other,
    )


def _gain_at_rest(problem: Problem, whitener: Whitener, fitted: Fit) -> float:
    """What the process brings while the table rests, over a level of each step's own.

    A bias that wanders does so at rest too. What only looks like it, because it follows the motion, does not: there
    the process predicts worse than none.
    """
    white = whitener(fitted.residual)
    process = level = rows = 0.0
    for number, kind in enumerate(problem.step_kinds):
        if kind != "static" or not fitted.fitted[number]:
            continue
        # what came before the step still works in the filter at its start
        whole = np.flatnonzero(problem.step == number)
        inside = whole[whole.size // 4 :]
        inside = inside[whitener.weight[inside] > 0.0]
        if inside.size < _FEWEST:
            continue
        alone = fitted.residual[inside]
        process += float(np.sum((white[inside] / whitener.weight[inside]) ** 2))
        level += float(np.sum((alone - alone.mean()) ** 2))
        rows += inside.size
    return rows * math.log(level / process) if process > 0.0 and level > 0.0 else 0.0


def _deviance(whitener: Whitener, columns: FloatArray, rows: BoolArray) -> float:
    """Minus twice the log likelihood of a residual, the first column, with the others refitted to it, on some rows."""
    count = float((whitener.weight[rows] > 0.0).sum())
    return count * math.log(_left(whitened_columns(whitener, columns)[rows])) + whitener.log_determinant


def _left(columns: FloatArray) -> float:
    """The sum of squares of the first column that the others leave."""
    products = columns.T @ columns
    gradient = products[1:, 0]
    return max(float(products[0, 0] - gradient @ inverse(products[1:, 1:]) @ gradient), 1e-300)


class _Blocks:
    """Residual and derivatives as means over many samples."""

    def __init__(self, problem: Problem, whitener: Whitener, columns: FloatArray, fitted: BoolArray) -> None:
        self._samples = max(1, round(_BLOCK_S / problem.interval_s))
        self._interval_s = self._samples * problem.interval_s
        self._lasts_s = float(problem.time_s[-1] - problem.time_s[0])
        starts = [
            np.arange(part.start, part.stop - self._samples + 1, self._samples)
            for part in problem.stretches
            if part.stop - part.start >= self._samples
        ]
        first = np.concatenate(starts) if starts else np.zeros(0, np.int64)
        rows = first[:, None] + np.arange(self._samples)
        usable = whitener.weight > 0.0
        counted = usable[rows].sum(axis=1)
        self._columns = np.stack(
            [np.where(usable, one, 0.0)[rows].sum(axis=1) / np.maximum(counted, 1) for one in columns.T], axis=1
        )
        self._fitted = fitted[problem.step[first]] if first.size else np.zeros(0, np.bool_)
        self._whitener = Whitener(
            interval_s=self._interval_s,
            weight=np.sqrt(counted / self._samples),
            time_s=problem.time_s[first],
        )

    def best(self, process: Process, least_gain: float) -> tuple[float, float]:
        """The largest gain and the size, over the deviation of a sample's white noise, where it lies.

        Sizes are a factor of two apart at first; only where one gains near `least_gain` it is looked at closer.
        """
        if not self._fitted.any():
            return 0.0, float(_SIZES[0])
        deviances = [self._deviance(process, size) for size in _SIZES.tolist()]
        place = int(np.argmin(deviances))
        without = self._deviance(process, 0.0)
        if without - deviances[place] < 0.5 * least_gain:
            return 0.0, float(_SIZES[place])
        around = np.log(_SIZES[[max(place - 1, 0), min(place + 1, _SIZES.size - 1)]])
        found = minimize_scalar(
            lambda log_size: self._deviance(process, math.exp(log_size)),
            bounds=tuple(around.tolist()),
            method="bounded",
            options={"xatol": _TOLERANCE},
        )
        return without - float(found.fun), math.exp(float(found.x))

    def _deviance(self, process: Process, size: float) -> float:
        # the white noise of a mean is smaller by the root of the samples, so the process beside it is larger
        relative = size * math.sqrt(self._samples)
        slow = process(relative, self._interval_s, self._lasts_s) if size > 0.0 else ()
        whitener = self._whitener.beside(slow)
        columns = whitened_columns(whitener, self._columns)[self._fitted]
        return float(self._fitted.sum()) * math.log(_left(columns)) + whitener.log_determinant
