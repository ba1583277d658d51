"""Joint Gauss-Newton fit of the lab's parameters and those of every effect in the model.

A fit stores the products of the whitened derivatives with each other and with the residual per step. The residual on
held-out steps can then be computed without reading the data again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from benchctl.estimation.noise import Whitener
from benchctl.estimation.point import Free as Free
from benchctl.estimation.point import Point as Point
from benchctl.estimation.problem import Problem
from benchctl.estimation.products import Products as Products
from benchctl.estimation.products import Spectral, products_of, squares_of, with_residual
from benchctl.side_by_side import do_all, parts_of, threads
from benchctl.signals.blocks import block_products
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

_LEAST_KNOWN = 0.05
_MOST_ROUNDS = 12
_CLOSE = 0.02
"""Iterations stop when the expected gain in twice the log likelihood is smaller."""
_RIDGE = 1e-10
_NUDGE = 1e-4


def solve(information: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return information⁻¹·gradient; directions not determined by the data get no step."""
    return inverse(information) @ gradient


def inverse(information: FloatArray) -> FloatArray:
    """Return the inverse (the covariance), computed at unit diagonal, without undetermined directions."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    positive = size > 0.0
    scale = np.where(positive, 1.0 / np.where(positive, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    kept = values > _RIDGE * max(float(values[-1]), 1e-300)
    inverted = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return np.asarray(inverted * np.outer(scale, scale))


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A fitted model. `residual` (n,) is measured minus predicted; `white` is the whitened residual.

    `derivatives` (n, p) are the whitened derivatives of the prediction by `numbers`, in the scale of the fit;
    `unwhitened` are those before the filter of `whitener`, if it has one; `spectral` is compared in addition to rows.
    """

    point: Point
    numbers: tuple[Free, ...]
    predicted: FloatArray
    residual: FloatArray
    white: FloatArray
    whitener: Whitener
    unwhitened: FloatArray | None
    derivatives: FloatArray
    spectral: Spectral
    products: Products
    fitted: BoolArray
    disturbed_covariance: FloatArray | None = None
    """Covariance (p, p) of the free parameters if the noise is known to differ from the model of `whitener`."""

    @property
    def raw_derivatives(self) -> FloatArray:
        """A copy of the derivatives before whitening, (n, p); zero in rows of weight 0."""
        if self.unwhitened is not None:
            return self.unwhitened.copy(order="K")
        weight = self.whitener.weight
        inverse_weight = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0.0)
        return np.asarray(self.derivatives * inverse_weight[:, None])

    @property
    def light(self) -> Fit:
        """The fit without its derivatives, which take most of the memory."""
        return replace(self, unwhitened=None, derivatives=np.zeros((0, len(self.numbers))))

    @cached_property
    def squares(self) -> float:
        """The sum of squares over the fitted steps."""
        return float(self.products.squares[self.fitted].sum())

    @cached_property
    def rows(self) -> float:
        """The number of rows in the fitted steps."""
        return float(self.products.rows[self.fitted].sum())

    @property
    def deviation(self) -> float:
        """Standard deviation of the innovations over the fitted rows."""
        return math.sqrt(self.squares / max(self.rows - len(self.numbers), 1.0))

    @cached_property
    def inverse_information(self) -> FloatArray:
        """Covariance of the free parameters for innovations of unit variance, shape (p, p)."""
        return inverse(self.products.of(self.fitted)[0])

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the free parameters for white noise, shape (p, p)."""
        return np.asarray(self.inverse_information * self.deviation**2)

    def beyond(self, columns: FloatArray, step: IntArray) -> FloatArray:
        """Return whitened columns, shape (k, n), minus their projection on the derivatives over the fitted steps."""
        followed = (columns * self.fitted[step]) @ self.derivatives @ self.inverse_information
        return np.asarray(columns - followed @ self.derivatives.T)

    @property
    def step_left(self) -> FloatArray:
        """The next step of the parameters, shape (p,), within their bounds; nearly zero if the fit has converged."""
        information, gradient, *_ = self.products.of(self.fitted)
        values = self.point.values(self.numbers)
        return _inside(self.point, self.numbers, values, information, gradient)

    def robust_covariance(self, step: IntArray) -> FloatArray:
        """Return the robust covariance of the free parameters, shape (p, p); `step` (n,) is the problem's.

        It is never smaller than for white noise, and larger if the products of residual and derivatives, summed over
        half a second each, scatter more (White, Econometrica 48, 1980).
        """
        if self.disturbed_covariance is not None:
            return self.disturbed_covariance
        inverse_information = self.inverse_information
        usual = self.covariance
        sums = block_products(self.derivatives, self.white * self.fitted[step])
        scattered = np.diag(inverse_information @ (sums.T @ sums) @ inverse_information)
        usual_variance = np.diag(usual)
        ratio = np.where(usual_variance > 0.0, scattered / np.where(usual_variance > 0.0, usual_variance, 1.0), 1.0)
        wider = np.sqrt(np.maximum(ratio, 1.0))
        return np.asarray(usual * np.outer(wider, wider))

    def standard_errors(self, step: IntArray) -> FloatArray:
        """Return the robust standard errors of the free parameters, shape (p,); infinite where not determined."""
        variance = np.diag(self.robust_covariance(step))
        return np.sqrt(np.where(variance > 0.0, variance, np.inf))


def fit(
    problem: Problem,
    whitener: Whitener,
    start: Point | Fit,
    fitted: BoolArray,
    *,
    rounds: int = _MOST_ROUNDS,
    near: Fit | None = None,
) -> Fit:
    """Fit a model's parameters, from their current values, to some steps (a mask of shape (m,) over all steps).

    If `start` is a fit of the same rows, with any whitener, its derivatives are reused. `near` is a fit of the same
    rows without the last effect; its derivatives are reused because one small effect hardly changes them.
    Levenberg-Marquardt damping is applied only if a full step does not reduce the sum of squares.
    """
    if near is not None and near.whitener is not whitener:
        near = fit(problem, whitener, near, near.fitted, rounds=0)
    point = start.point if isinstance(start, Fit) else start
    numbers = tuple(point.free(problem.baseline_names, problem.baseline_bounds))
    predicted = start.predicted if isinstance(start, Fit) else problem.predict(point.baseline, point.effects)
    white = whitener(problem.measured - predicted)
    spectrum = problem.spectral_residual(point.baseline, point.effects)
    squares = float(squares_of(problem, white, spectrum)[fitted].sum())
    if isinstance(start, Fit):
        raw, derivatives = _whitened(whitener, start.raw_derivatives)
        turned = start.spectral.derivatives
    else:
        raw, derivatives, turned = _derivatives(problem, whitener, point, numbers, predicted, spectrum, near)
    spectral = Spectral(residual=spectrum, derivatives=turned)
    known = None if near is None else near.products
    products = products_of(problem, derivatives, white, whitener, spectral, known)
    linear = near is not None and all(_is_size(number) for number in numbers[len(near.numbers) :])
    damping = 0.0
    for _ in range(rounds):
        information, gradient, total, rows = products.of(fitted)
        values = point.values(numbers)
        damped = information + damping * np.diag(np.diag(information))
        step = _inside(point, numbers, values, damped, gradient)
        variance = max(total / max(rows, 1.0), 1e-300)
        expected = float(step @ gradient) / variance
        trial = point.moved(numbers, values + step)
        trial_predicted = problem.predict(trial.baseline, trial.effects)
        trial_white = whitener(problem.measured - trial_predicted)
        trial_spectrum = problem.spectral_residual(trial.baseline, trial.effects)
        trial_squares = float(squares_of(problem, trial_white, trial_spectrum)[fitted].sum())
        if not trial_squares <= squares + 1e-9 * variance:
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e6:
                break
            continue
        gained = (squares - trial_squares) / variance
        point, predicted, white, spectrum, squares = trial, trial_predicted, trial_white, trial_spectrum, trial_squares
        close = damping == 0.0 and expected < _CLOSE
        damping = damping / 10.0 if damping > 1e-3 else 0.0
        if close or linear:  # the derivatives are unchanged
            spectral = replace(spectral, residual=spectrum)
            products = with_residual(problem, products, derivatives, white, spectral)
            if close or gained < _CLOSE:
                break
            continue
        del raw, derivatives  # free the memory first: the new arrays are as large
        raw, derivatives, turned = _derivatives(problem, whitener, point, numbers, predicted, spectrum, near)
        spectral = Spectral(residual=spectrum, derivatives=turned)
        products = products_of(problem, derivatives, white, whitener, spectral, known)
        if gained < _CLOSE:
            break
    return Fit(
        point=point,
        numbers=numbers,
        predicted=predicted,
        residual=problem.measured - predicted,
        white=white,
        whitener=whitener,
        unwhitened=raw,
        derivatives=derivatives,
        spectral=spectral,
        products=products,
        fitted=fitted,
    )


def _inside(
    point: Point, numbers: tuple[Free, ...], values: FloatArray, information: FloatArray, gradient: FloatArray
) -> FloatArray:
    """Return the step within the bounds: parameters at a bound are fixed, and the step of the others is recomputed."""
    step = solve(information, gradient)
    moved = point.moved(numbers, values + step)
    here = point.values(numbers)
    there = np.array([moved.value(number, i) for i, number in enumerate(numbers)])
    free = (there != here) | (step == 0.0)
    if free.all():
        return step
    held = np.zeros_like(step)
    if not free.any():
        return held
    held[free] = solve(information[np.ix_(free, free)], gradient[free])
    return held


def judged(problem: Problem, fitted: Fit) -> FloatArray:
    """Return the errors by which a model is judged, shape (n,): innovations, or residuals of the measured quantity.

    The residuals are used for a disturbed problem, because innovations do not show the error for a user of the model.
    """
    return np.where(problem.usable, fitted.residual, 0.0) if problem.disturbed else fitted.white


def gain_of(better: Fit, worse: Fit, steps: BoolArray | None = None) -> float:
    """Return the increase of twice the log likelihood, on the fitted or on other steps, with the same noise."""
    chosen = better.fitted if steps is None else steps
    rows = float(better.products.rows[chosen].sum())
    good, bad = (max(float(one.products.squares[chosen].sum()), 1e-300) for one in (better, worse))
    return rows * math.log(bad / good)


def gain_alone(better: Fit, worse: Fit, steps: BoolArray) -> float:
    """Return the gain on some of the fitted steps, each model with the baseline refitted there."""
    chosen = better.fitted & steps
    good, bad = (_squares_alone(one, chosen) for one in (better, worse))
    return float(better.products.rows[chosen].sum()) * math.log(bad / good)


def _squares_alone(one: Fit, steps: BoolArray) -> float:
    information, gradient, squares, _ = one.products.of(steps)
    own = np.array([number.effect is None for number in one.numbers])
    step = solve(information[np.ix_(own, own)], gradient[own])
    return max(squares - float(step @ gradient[own]), 1e-300)


def gain_kept(better: Fit, worse: Fit, folds: IntArray) -> float:
    """Return the increase of twice the log likelihood under cross-validation.

    `folds` (m,) assigns the fitted steps to folds. Each fold is predicted from the others by one Newton step from the
    fit to all steps, using only the products per step. Parameters that only the fold itself determines (the level at
    the start of a walk) are not changed.
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
        # in these coordinates the total information is the identity; `share` is the part of the other folds
        share, axes = np.linalg.eigh(np.eye(values.size) - root.T @ own[0] @ root)
        known = share > _LEAST_KNOWN
        step = axes[:, known] / share[known] @ (axes[:, known].T @ (root.T @ (gradient - own[1])))
        moved = root @ step
        total += own[2] - 2.0 * float(moved @ own[1]) + float(moved @ own[0] @ moved)
    return total


def _is_size(number: Free) -> bool:
    """Return whether the prediction is linear in a parameter, if all later stages are linear."""
    return number.parameter is not None and number.parameter.role == "size"


def _derivatives(
    problem: Problem,
    whitener: Whitener,
    point: Point,
    numbers: tuple[Free, ...],
    predicted: FloatArray,
    spectrum: FloatArray,
    near: Fit | None,
) -> tuple[FloatArray | None, FloatArray, FloatArray]:
    """Return the derivatives by all parameters, those of `near` unchanged.

    They are those of the prediction, shape (n, p), if the whitener has a filter, the whitened ones, and those of the
    spectrum, shape (w, p).
    """
    taken, turned = _differences(problem, point, numbers, predicted, spectrum, 0 if near is None else len(near.numbers))
    raw, white = _whitened(whitener, taken)
    if near is None:
        return raw, white, turned
    raw = None if raw is None or near.unwhitened is None else _joined(near.unwhitened, raw)
    return raw, _joined(near.derivatives, white), _joined(near.spectral.derivatives, turned)


def _joined(known: FloatArray, more: FloatArray) -> FloatArray:
    """Return columns (n, k) followed by more columns, each contiguous."""
    both = np.empty((len(known), known.shape[1] + more.shape[1]), order="F")
    both[:, : known.shape[1]], both[:, known.shape[1] :] = known, more
    return both


def _differences(
    problem: Problem,
    point: Point,
    numbers: tuple[Free, ...],
    predicted: FloatArray,
    spectrum: FloatArray,
    first: int,
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives by the parameters from `first` on: of the prediction, (n, k), and the spectrum, (w, k)."""
    derivatives = np.empty((predicted.size, len(numbers) - first), order="F")
    turned = np.empty((spectrum.size, len(numbers) - first))
    values = point.values(numbers)

    def fill(i: int) -> None:
        number = numbers[i]
        nudge = _nudge(problem, number, float(values[i]), i)
        moved = values.copy()
        moved[i] += nudge
        other = point.moved(numbers, moved)
        if other.value(number, i) == values[i]:  # at its upper bound
            moved[i] -= 2 * nudge
            nudge = -nudge
            other = point.moved(numbers, moved)
        column = derivatives[:, i - first]
        np.subtract(problem.predict(other.baseline, other.effects), predicted, out=column)
        column /= nudge
        turned[:, i - first] = (spectrum - problem.spectral_residual(other.baseline, other.effects)) / nudge

    do_all(fill, range(first, len(numbers)))
    return derivatives, turned


def _whitened(whitener: Whitener, raw: FloatArray) -> tuple[FloatArray | None, FloatArray]:
    """Return the derivatives (n, p), if the whitener has a filter, and the whitened ones; may overwrite `raw`."""
    if whitener.slow:
        return raw, whitened_columns(whitener, raw)

    def weigh(column: FloatArray) -> None:
        column *= whitener.weight

    do_all(weigh, raw.T)
    return None, raw


def whitened_columns(whitener: Whitener, columns: FloatArray) -> FloatArray:
    """Return the whitened columns of an array (n, p)."""
    white = np.empty_like(columns, order="F")

    def fill(some: slice) -> None:
        white[:, some] = whitener(columns[:, some].T).T

    do_all(fill, parts_of(columns.shape[1], threads()))
    return white


def _nudge(problem: Problem, number: Free, value: float, index: int) -> float:
    """Return the finite-difference step of a parameter."""
    parameter = number.parameter
    if parameter is None:
        start = abs(float(problem.baseline_start[index]))
        return _NUDGE * (start if start > 0.0 else max(abs(value), 1e-6))
    if parameter.role == "phase":
        return 0.05
    if parameter.logarithmic:
        return parameter.nudge
    return parameter.nudge * (max(abs(value), abs(parameter.scan[0])) or max(map(abs, parameter.scan)))
