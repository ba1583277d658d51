"""Which effects a recording cannot tell apart: computed from its own motion, temperatures and noise.

What an effect changes, whitened and without what the rest of the model can follow, is one direction in the space of all
samples; what another effect can make of it, its numbers free, is a share of that direction (the squared cosine of a
principal angle; Björck & Golub, Math. Comp. 27, 1973). The two part by (1 − share)·gain in twice the log likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fitting.closest import Known, distance, without_direction
from benchctl.diagnosis.fitting.fit import Fit, Free, Point, inverse
from benchctl.diagnosis.fitting.noise import Whitener
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.search.probes import probes_of
from instruments.physics.effects.effect import DescribedEffect

FloatArray = npt.NDArray[np.float64]

ALIKE = 10.0
"""Two effects are alike where twice the log likelihood parts them by less: odds of 150 to 1 at the most."""


def imitated(first: FloatArray, second: FloatArray, known: FloatArray) -> float:
    """The largest share, 0 to 1, of a direction of `first` that `second` can make, beside what is known anyhow.

    Columns are whitened changes of the prediction, shapes (n, a), (n, b) and (n, p); the share is the squared cosine of
    the smallest principal angle between the two, both without what `known` makes of them.
    """
    own, other = (without_direction(known, columns) for columns in (first, second))
    crossed = own.T @ other
    shares = inverse(own.T @ own) @ crossed @ inverse(other.T @ other) @ crossed.T
    return float(np.clip(np.max(np.real(np.linalg.eigvals(shares))), 0.0, 1.0))


def separation(
    problem: Problem,
    whitener: Whitener,
    fitted: Fit,
    first: DescribedEffect,
    second: DescribedEffect | type[DescribedEffect],
) -> float:
    """By how much twice the log likelihood is expected to fall where `second` takes the place of `first`.

    `first` is one of the fitted model's effects, at its fitted size; `second` is refitted to what the model with the
    first predicts, together with the baseline and the other effects, from the place named or, of a kind, from the best
    of its probes. It is what the motion and the temperatures can tell: the draw of this recording's noise has no part.
    """
    rows = fitted.fitted[problem.step] / fitted.deviation
    place = fitted.point.effects.index(first)
    others = tuple(one for one in fitted.point.effects if one is not first)
    baseline = fitted.point.baseline
    without = problem.predict(baseline, others)
    signal = whitener(fitted.predicted - without) * rows
    beside = np.array([number.effect != place for number in fitted.numbers])
    known = fitted.derivatives[:, beside] * rows[:, None]
    own = without_direction(known, signal)
    most, near, start = float(own @ own), math.inf, None
    for columns, made in _places(problem, second):
        changes = [problem.predict(baseline, (*others, column)) - without for column in columns]
        if not all(np.isfinite(change).all() for change in changes):
            continue
        block = without_direction(known, np.stack([whitener(change) * rows for change in changes], axis=1))
        weights = inverse(block.T @ block) @ (block.T @ own)
        left = float(np.sum((own - block @ weights) ** 2))
        if left < near:
            near, start = left, made(weights)
    if start is None:
        return most
    errors = np.sqrt(np.diag(fitted.covariance))[beside]
    freed = _free(Point(baseline=baseline, effects=(*others, start)), problem.baseline_names, errors)
    return min(most, distance(fitted.predicted, freed, problem.predict, lambda column: whitener(column) * rows))


def _places(
    problem: Problem, second: DescribedEffect | type[DescribedEffect]
) -> Iterator[tuple[tuple[DescribedEffect, ...], Callable[[FloatArray], DescribedEffect]]]:
    """Where an imitation may begin: columns, and the effect that is their weighted sum."""
    if isinstance(second, DescribedEffect):
        yield (second,), lambda _weights: second
        return
    for probe in probes_of(problem, second):
        yield probe.columns, probe.start


def _free(point: Point, names: Sequence[str], errors: FloatArray) -> Known:
    """A model of whose numbers nothing is said; `errors` are those that all but its last effect's are known to."""
    numbers = tuple(point.free(names))
    values = np.array([point.value(number, i) for i, number in enumerate(numbers)])
    sizes = [_scale(number, value) for number, value in zip(numbers[errors.size :], values[errors.size :], strict=True)]
    count = len(numbers)
    return Known(
        point=point,
        numbers=numbers,
        values=values,
        information=np.zeros((count, count)),
        covariance=np.diag(np.concatenate([errors, sizes]) ** 2),
    )


def _scale(number: Free, value: float) -> float:
    """A tenth of a number that is free: what its derivative may be taken over."""
    parameter = number.parameter
    if parameter is None or parameter.logarithmic:
        return 0.1
    return 5.0 if parameter.role == "phase" else 0.1 * max(abs(value), abs(parameter.scan[0]))
