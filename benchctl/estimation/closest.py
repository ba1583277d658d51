"""Distance of one model from another: its numbers are refitted to the other's prediction, within their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchctl.estimation.fit import Fit, Free, Point, solve
from benchctl_instruments.arrays import FloatArray

Column = Callable[[FloatArray], FloatArray]
Predict = Callable[[FloatArray, Sequence[Any]], FloatArray]

_ROUNDS = 8
_HALVINGS = 4
_CLOSE = 0.1
"""Iterations end when twice the log likelihood is expected to change by less than this."""
_NUDGE = 0.1
"""Step of a number for its derivative, in its standard errors."""
_SMALL = 1e-2
"""Assumed standard error, for its derivative, of an unknown number, as a share of its size."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """A model and its numbers as determined by a recording: values (p,), information and covariance (p, p)."""

    point: Point
    numbers: tuple[Free, ...]
    values: FloatArray
    information: FloatArray
    covariance: FloatArray


def known_from(fitted: Fit, *, anew: str = "") -> Known:
    """Return a fit's information on its numbers; that on `anew`, a bias that may have changed since, is removed."""
    information = fitted.products.of(fitted.fitted)[0] / fitted.deviation**2
    for i, number in enumerate(fitted.numbers):
        if number.name == anew and number.effect is None and information[i, i] > 0.0:
            information = information - np.outer(information[:, i], information[i]) / information[i, i]
    values = fitted.point.values(fitted.numbers)
    return Known(
        point=fitted.point,
        numbers=fitted.numbers,
        values=values,
        information=information,
        covariance=fitted.covariance,
    )


def nothing_known(point: Point, numbers: tuple[Free, ...]) -> Known:
    """Return a model with unknown numbers, whose changes cost nothing."""
    values = point.values(numbers)
    errors = np.array([_SMALL * _size(number, value) for number, value in zip(numbers, values.tolist(), strict=True)])
    return Known(
        point=point,
        numbers=numbers,
        values=values,
        information=np.zeros((values.size, values.size)),
        covariance=np.diag(errors**2),
    )


def _size(number: Free, value: float) -> float:
    """Return the typical size of a number in the scale of the fit."""
    parameter = number.parameter
    if parameter is None:
        return abs(value) or 1.0
    return 1.0 if parameter.logarithmic else max(abs(value), abs(parameter.scan[0]))


def distance(target: FloatArray, known: Known, predict: Predict, whiten: Column) -> float:
    """Return the minimum of Σ((target − prediction)/σ)², (n,) whitened to unit variance, over the model's numbers.

    Deviations of numbers from the recording's values add to it: the sum is the difference of the two models in twice
    the log likelihood. Gauss-Newton iterations; each step is halved until the sum decreases.
    """
    sizes = np.sqrt(np.maximum(np.diag(known.covariance), 0.0))
    values, point = known.values, known.point
    predicted = predict(point.baseline, point.effects)
    rest = whiten(target - predicted)
    cost = float(rest @ rest)
    for _ in range(_ROUNDS):
        if cost <= _CLOSE:
            break
        slopes = _slopes(known, values, predicted, sizes, predict, whiten)
        gradient = slopes.T @ rest - known.information @ (values - known.values)
        step = solve(slopes.T @ slopes + known.information, gradient)
        before = cost
        for halving in range(_HALVINGS):
            trial = values + step * 0.5**halving
            moved = point.moved(known.numbers, trial)
            trial_predicted = predict(moved.baseline, moved.effects)
            trial_rest = whiten(target - trial_predicted)
            away = trial - known.values
            trial_cost = float(trial_rest @ trial_rest + away @ known.information @ away)
            if trial_cost < cost:
                values, predicted, rest, cost = trial, trial_predicted, trial_rest, trial_cost
                break
        if before - cost < _CLOSE:
            break
    return cost


def _slopes(
    known: Known, values: FloatArray, predicted: FloatArray, sizes: FloatArray, predict: Predict, whiten: Column
) -> FloatArray:
    """Return whitened derivatives by every number, shape (n, p); zero for numbers with zero uncertainty."""
    slopes = np.zeros((predicted.size, values.size), order="F")
    for i, size in enumerate((_NUDGE * sizes).tolist()):
        if size <= 0.0:
            continue
        moved = values.copy()
        moved[i] += size
        other = known.point.moved(known.numbers, moved)
        slopes[:, i] = whiten(predict(other.baseline, other.effects) - predicted) / size
    return slopes
