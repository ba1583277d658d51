"""A joint fit: the lab's own parameters and those of every effect in the model at once, by Gauss and Newton.

All that a fit needs of the rows, it keeps per step: the products of the whitened derivatives with each other and with
the residual. What it leaves on steps that it was not fitted to then costs no look at the data.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fitting.noise import Whitener
from benchctl.diagnosis.problem import Problem
from benchctl.diagnosis.signals.blocks import block_starts
from instruments.physics.effects.effect import DescribedEffect, Parameter

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

_LEAST_KNOWN = 0.05
_MOST_ROUNDS = 12
_CLOSE = 0.02
"""Rounds end when twice the log likelihood is expected to gain less."""
_RIDGE = 1e-10
_NUDGE = 1e-4
_SMALLEST = 1e-300
"""Below it a number that is moved in its logarithm does not go."""


@dataclass(frozen=True, slots=True)
class Free:
    """One number that is fitted: a parameter of the baseline (`effect` is None) or of the effect at a place."""

    name: str
    effect: int | None
    parameter: Parameter | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A model: the baseline's parameters, shape (p,), and effects."""

    baseline: FloatArray
    effects: tuple[DescribedEffect, ...] = ()

    def free(self, names: Sequence[str]) -> list[Free]:
        """Everything that can be fitted at this point; `names` are those of the baseline."""
        numbers = [Free(name, None, None) for name in names]
        for place, effect in enumerate(self.effects):
            numbers += [
                Free(name, place, parameter)
                for name, parameter in effect.parameters.items()
                if parameter.role != "choice"
            ]
        return numbers

    def value(self, number: Free, index: int) -> float:
        """The present value of a free number, in the scale in which it is moved."""
        if number.effect is None:
            return float(self.baseline[index])
        value = float(getattr(self.effects[number.effect], number.name))
        return math.log(max(value, _SMALLEST)) if _in_logarithms(number) else value

    def moved(self, numbers: Sequence[Free], values: FloatArray) -> Point:
        """The model with its free numbers at other values, each kept within its bounds."""
        baseline = self.baseline.copy()
        effects = list(self.effects)
        for index, (number, value) in enumerate(zip(numbers, values.tolist(), strict=True)):
            if number.effect is None:
                baseline[index] = value
            else:
                effects[number.effect] = replace(  # type: ignore[type-var]  # every effect is a dataclass
                    effects[number.effect], **{number.name: _bounded(number, value)}
                )
        return Point(baseline=baseline, effects=tuple(effects))


def _in_logarithms(number: Free) -> bool:
    return number.parameter is not None and number.parameter.logarithmic


def _bounded(number: Free, value: float) -> float:
    parameter = number.parameter
    if parameter is None:
        return value
    if parameter.role == "phase":
        return value % 360.0
    if parameter.logarithmic:
        value = max(math.exp(min(value, 700.0)), _SMALLEST)
    return min(max(value, parameter.low), parameter.high)


@dataclass(frozen=True, slots=True, kw_only=True)
class Products:
    """Sums over each step's rows: information (m, p, p), gradient (m, p), squares (m,) and rows that count (m,)."""

    information: FloatArray
    gradient: FloatArray
    squares: FloatArray
    rows: FloatArray

    def of(self, steps: BoolArray) -> tuple[FloatArray, FloatArray, float, float]:
        """Their sums over some steps, given as a mask of shape (m,)."""
        return (
            self.information[steps].sum(axis=0),
            self.gradient[steps].sum(axis=0),
            float(self.squares[steps].sum()),
            float(self.rows[steps].sum()),
        )


def solve(information: FloatArray, gradient: FloatArray) -> FloatArray:
    """The step information⁻¹·gradient; directions that the data do not have stay where they are."""
    return inverse(information) @ gradient


def inverse(information: FloatArray) -> FloatArray:
    """The covariance: the inverse in units in which the diagonal is one, without the directions that are not seen."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    seen = size > 0.0
    scale = np.where(seen, 1.0 / np.where(seen, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    kept = values > _RIDGE * max(float(values[-1]), 1e-300)
    inverted = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return np.asarray(inverted * np.outer(scale, scale))


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted model. `residual` (n,) is measured less predicted; `white` the same, whitened.

    `raw_derivatives` (n, p) are those of the prediction by `numbers`, in the scale in which these are moved;
    `derivatives` the same, whitened.
    """

    point: Point
    numbers: tuple[Free, ...]
    predicted: FloatArray
    residual: FloatArray
    white: FloatArray
    raw_derivatives: FloatArray
    derivatives: FloatArray
    products: Products
    fitted: BoolArray

    @cached_property
    def squares(self) -> float:
        """The sum of squares over the fitted steps."""
        return float(self.products.squares[self.fitted].sum())

    @cached_property
    def rows(self) -> float:
        """How many rows the fitted steps have."""
        return float(self.products.rows[self.fitted].sum())

    @property
    def deviation(self) -> float:
        """Deviation of an innovation: root of the mean square over the fitted rows."""
        return math.sqrt(self.squares / max(self.rows - len(self.numbers), 1.0))

    @cached_property
    def inverse_information(self) -> FloatArray:
        """The covariance of the free numbers for innovations of deviation one, shape (p, p)."""
        return inverse(self.products.of(self.fitted)[0])

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the free numbers where the noise is white, shape (p, p)."""
        return np.asarray(self.inverse_information * self.deviation**2)

    def robust_covariance(self, step: IntArray) -> FloatArray:
        """Covariance of the free numbers, shape (p, p), whatever the noise; `step` (n,) is the problem's.

        Never smaller than white noise would make it; larger where the residual's products with the derivatives, summed
        over half a second each, scatter more (White, Econometrica 48, 1980).
        """
        inverse_information = self.inverse_information
        usual = self.covariance
        rows = self.fitted[step]
        products = self.derivatives * (self.white * rows)[:, None]
        sums = np.add.reduceat(products, block_starts(rows.size), axis=0)
        scattered = np.diag(inverse_information @ (sums.T @ sums) @ inverse_information)
        usual_variance = np.diag(usual)
        ratio = np.where(usual_variance > 0.0, scattered / np.where(usual_variance > 0.0, usual_variance, 1.0), 1.0)
        wider = np.sqrt(np.maximum(ratio, 1.0))
        return np.asarray(usual * np.outer(wider, wider))


def fit(problem: Problem, whitener: Whitener, start: Point, fitted: BoolArray, *, rounds: int = _MOST_ROUNDS) -> Fit:
    """Fit a model's numbers, from where they are, to some steps (a mask of shape (m,) over the problem's steps).

    Levenberg and Marquardt's damping only where a whole step does not go down.
    """
    numbers = tuple(start.free(problem.baseline_names))
    point = start
    predicted = problem.predict(point.baseline, point.effects)
    white = whitener(problem.measured - predicted)
    squares = _squares(problem, white, fitted)
    damping = 0.0
    linear = _linearised(problem, whitener, point, numbers, predicted, white)
    for _ in range(rounds):
        information, gradient, total, rows = linear[2].of(fitted)
        values = np.array([point.value(number, i) for i, number in enumerate(numbers)])
        damped = information + damping * np.diag(np.diag(information))
        step = _inside(point, numbers, values, damped, gradient)
        variance = max(total / max(rows, 1.0), 1e-300)
        trial = point.moved(numbers, values + step)
        trial_predicted = problem.predict(trial.baseline, trial.effects)
        trial_white = whitener(problem.measured - trial_predicted)
        trial_squares = _squares(problem, trial_white, fitted)
        if not trial_squares <= squares + 1e-9 * variance:
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e6:
                break
            continue
        gained = (squares - trial_squares) / variance
        point, predicted, white, squares = trial, trial_predicted, trial_white, trial_squares
        damping = damping / 10.0 if damping > 1e-3 else 0.0
        linear = _linearised(problem, whitener, point, numbers, predicted, white)
        if gained < _CLOSE:
            break
    return Fit(
        point=point,
        numbers=numbers,
        predicted=predicted,
        residual=problem.measured - predicted,
        white=white,
        raw_derivatives=linear[0],
        derivatives=linear[1],
        products=linear[2],
        fitted=fitted,
    )


def _inside(
    point: Point, numbers: tuple[Free, ...], values: FloatArray, information: FloatArray, gradient: FloatArray
) -> FloatArray:
    """The step; a number that stands at a bound and would go beyond holds still, and the others go their own way."""
    step = solve(information, gradient)
    moved = point.moved(numbers, values + step)
    here = np.array([point.value(number, i) for i, number in enumerate(numbers)])
    there = np.array([moved.value(number, i) for i, number in enumerate(numbers)])
    free = (there != here) | (step == 0.0)
    if free.all():
        return step
    held = np.zeros_like(step)
    if not free.any():
        return held
    held[free] = solve(information[np.ix_(free, free)], gradient[free])
    return held


def gain_of(better: Fit, worse: Fit, steps: BoolArray | None = None) -> float:
    """By how much twice the log likelihood is larger, on the fitted steps or on others, with the same noise."""
    chosen = better.fitted if steps is None else steps
    rows = float(better.products.rows[chosen].sum())
    good, bad = (max(float(one.products.squares[chosen].sum()), 1e-300) for one in (better, worse))
    return rows * math.log(bad / good)


def gain_kept(better: Fit, worse: Fit, folds: IntArray) -> float:
    """By how much twice the log likelihood is larger on steps that a model was not fitted to.

    `folds` (m,) deals the fitted steps out; each fold is predicted from the others, by one Newton step away from the
    fit to all: the products per step are all that it takes. What only the fold itself knows (the level at the start
    of a walk) stays as it is.
    """
    good, bad = _squares_kept(better, folds), _squares_kept(worse, folds)
    return better.rows * math.log(max(bad, 1e-300) / max(good, 1e-300))


def _squares_kept(one: Fit, folds: IntArray) -> float:
    products = one.products
    information, gradient, *_ = products.of(one.fitted)
    values, vectors = np.linalg.eigh(inverse(information))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    total = 0.0
    for fold in np.unique(folds[one.fitted]).tolist():
        own = products.of(one.fitted & (folds == fold))
        # in these coordinates all steps together know every direction alike, and the others' share is what is left
        share, axes = np.linalg.eigh(np.eye(values.size) - root.T @ own[0] @ root)
        known = share > _LEAST_KNOWN
        step = axes[:, known] / share[known] @ (axes[:, known].T @ (root.T @ (gradient - own[1])))
        moved = root @ step
        total += own[2] - 2.0 * float(moved @ own[1]) + float(moved @ own[0] @ moved)
    return total


def _squares(problem: Problem, white: FloatArray, fitted: BoolArray) -> float:
    return float(_per_step(problem, white * white)[fitted].sum())


def _per_step(problem: Problem, values: FloatArray) -> FloatArray:
    sums = np.bincount(problem.step, values, minlength=len(problem.step_names))
    return sums.astype(np.float64)


def _linearised(
    problem: Problem,
    whitener: Whitener,
    point: Point,
    numbers: tuple[Free, ...],
    predicted: FloatArray,
    white: FloatArray,
) -> tuple[FloatArray, FloatArray, Products]:
    """Derivatives by all numbers, shape (n, p), the same whitened, and their products per step."""
    derivatives = np.empty((predicted.size, len(numbers)), order="F")
    values = np.array([point.value(number, i) for i, number in enumerate(numbers)])
    for i, number in enumerate(numbers):
        nudge = _nudge(problem, number, float(values[i]), i)
        moved = values.copy()
        moved[i] += nudge
        other = point.moved(numbers, moved)
        if number.effect is not None and other.value(number, i) == values[i]:  # at its upper bound
            moved[i] -= 2 * nudge
            nudge = -nudge
            other = point.moved(numbers, moved)
        derivatives[:, i] = (problem.predict(other.baseline, other.effects) - predicted) / nudge
    whitened = whitened_columns(whitener, derivatives)
    return derivatives, whitened, products_of(problem, whitened, white, whitener)


def whitened_columns(whitener: Whitener, columns: FloatArray) -> FloatArray:
    """Every column of (n, p), whitened."""
    white = np.empty_like(columns, order="F")
    for i in range(columns.shape[1]):
        white[:, i] = whitener(columns[:, i])
    return white


def products_of(problem: Problem, derivatives: FloatArray, white: FloatArray, whitener: Whitener) -> Products:
    """The products per step of whitened derivatives (n, p) and residuals (n,)."""
    steps = len(problem.step_names)
    bounds = np.searchsorted(problem.step, np.arange(steps + 1))
    count = derivatives.shape[1]
    information, gradient = np.zeros((steps, count, count)), np.zeros((steps, count))
    for step in range(steps):
        rows = slice(bounds[step], bounds[step + 1])
        block = derivatives[rows]
        information[step] = block.T @ block
        gradient[step] = block.T @ white[rows]
    return Products(
        information=information,
        gradient=gradient,
        squares=_per_step(problem, white * white),
        rows=_per_step(problem, (whitener.weight > 0.0).astype(np.float64)),
    )


def _nudge(problem: Problem, number: Free, value: float, index: int) -> float:
    """How far a number is moved for its derivative."""
    parameter = number.parameter
    if parameter is None:
        start = abs(float(problem.baseline_start[index]))
        return _NUDGE * (start if start > 0.0 else max(abs(value), 1e-6))
    if parameter.role == "phase":
        return 0.05
    if parameter.logarithmic:
        return parameter.nudge
    return parameter.nudge * max(abs(value), abs(parameter.scan[0]))
