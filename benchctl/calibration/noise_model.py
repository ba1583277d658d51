"""Estimate the noise from the data: white within steps, a random walk of the bias across them.

Within a step the blocks scatter about the step's mean. Their noise is not white: the encoder's noise is differentiated,
and its quantisation error recurs in every cycle of a sine. The part that the fit absorbs is therefore measured in the
relevant directions, in which each step changes the parameters (`score_scatter`), pooled over the steps.

Means of steps i and j have the covariance D_i·δ_ij + q·W_ij, with
D_i = white variance over the samples of the step and W that of the mean of a Wiener process: W_ij = middle of the
earlier step for i ≠ j, and W_ii = middle − duration/6. q and a factor on D come from the restricted likelihood
(Patterson and Thompson, Biometrika 58 (1971) 545), in which the parameters have been integrated out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from benchctl_instruments.arrays import FloatArray, IntArray

_FEWEST_STEPS_FOR_WALK = 4
_FEWEST_STEPS_FOR_EXCESS = 12
_FEWEST_STEPS_FOR_SCATTER = 5
_LEAST_RATIO = 0.2
_COLLINEAR = 1e-3
_EXCESS_LOG_SCALE = 0.5
_FARTHEST_LOG_WALK = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MeansNoise:
    """Noise of the means: `walk` is q in V²/s, `excess` the factor on the variance expected from the samples."""

    walk: float
    excess: float


def walk_covariance(middle_s: FloatArray, duration_s: FloatArray) -> FloatArray:
    """Return the covariance of the means of a Wiener process of unit strength over steps in time order, (m, m), s."""
    covariance = np.minimum.outer(middle_s, middle_s)
    covariance[np.diag_indices(middle_s.size)] = np.maximum(middle_s - duration_s / 6.0, 0.0)
    return covariance


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearMeans:
    """The means of the steps, linearised at the current parameters, and the information of all other rows.

    The coordinates make both the walk and the white noise diagonal, so that every trial noise is cheap: eigenvalues ν
    of D^-½·W·D^-½, shape (m,), residuals (m,) and derivatives (m, p). `log_white` is ln det D; `information` (p, p) and
    `gradient` (p,) are those of all other rows. `variance` and `exposure` are the diagonals of D and W.
    """

    eigenvalues: FloatArray
    residual: FloatArray
    derivative: FloatArray
    log_white: float
    information: FloatArray
    gradient: FloatArray
    variance: FloatArray
    exposure: FloatArray

    def solve(self, noise: MeansNoise) -> tuple[FloatArray, FloatArray, float]:
        """Return total information (p, p), total gradient (p,) and twice the negative restricted log likelihood."""
        variance = noise.excess + noise.walk * self.eigenvalues
        weighted = self.derivative / variance[:, None]
        information = self.information + self.derivative.T @ weighted
        gradient = self.gradient + weighted.T @ self.residual
        scale = 1.0 / np.sqrt(np.diag(information))
        scaled = information * np.outer(scale, scale)
        shift = np.linalg.solve(scaled, gradient * scale) * scale
        deviance = (
            self.log_white
            + float(np.sum(np.log(variance)))
            + float(np.linalg.slogdet(scaled)[1])
            - 2 * float(np.sum(np.log(scale)))
            + float(np.sum(self.residual**2 / variance))
            - float(gradient @ shift)
        )
        return information, gradient, deviance


def linear_means(
    residual: FloatArray,
    derivative: FloatArray,
    white: FloatArray,
    wiener: FloatArray,
    information: FloatArray,
    gradient: FloatArray,
) -> LinearMeans:
    """Transform residuals (m,) and derivatives (m, p) of means to the walk's axes; `white` (m,) is D, `wiener` is W."""
    root = 1.0 / np.sqrt(white)
    values, vectors = np.linalg.eigh(wiener * np.outer(root, root))
    return LinearMeans(
        eigenvalues=np.maximum(values, 0.0),
        residual=vectors.T @ (residual * root),
        derivative=vectors.T @ (derivative * root[:, None]),
        log_white=float(np.sum(np.log(white))),
        information=information,
        gradient=gradient,
        variance=white,
        exposure=np.diag(wiener).copy(),
    )


def estimate(means: LinearMeans, start: MeansNoise | None = None) -> MeansNoise:
    """Estimate q and the excess by restricted maximum likelihood; with few steps the excess is 1, then the walk 0."""
    steps = means.residual.size
    if steps < _FEWEST_STEPS_FOR_WALK:
        return MeansNoise(walk=0.0, excess=1.0)
    typical = float(np.median(means.variance)) / max(float(np.median(means.exposure)), 1e-9)
    first = np.array([np.log(start.walk / typical) if start and start.walk > 0 else 0.0, 0.0])
    if start:
        first[1] = np.log(start.excess)
    free = 2 if steps >= _FEWEST_STEPS_FOR_EXCESS else 1

    def noise_at(logs: FloatArray) -> MeansNoise:
        bounded = np.clip(logs, -25.0, 25.0)
        excess = float(np.exp(bounded[1])) if free == 2 else 1.0
        return MeansNoise(walk=typical * float(np.exp(bounded[0])), excess=excess)

    def deviance(logs: FloatArray) -> float:
        beyond = float(np.sum(np.maximum(np.abs(logs) - 25.0, 0.0)))
        # Heavy-tailed prior: near 1 if the walk could also explain it, free to be large if the model does not fit.
        unlikely = 4 * float(np.log1p((float(logs[1]) / _EXCESS_LOG_SCALE) ** 2 / 4)) if free == 2 else 0.0
        return means.solve(noise_at(logs))[2] + beyond + unlikely

    first = first[:free]
    if start is None:
        excesses = (0.0, 3.0, 8.0) if free == 2 else (0.0,)
        trials = [np.array([level, high][:free]) for level in np.linspace(-6.0, 15.0, 8) for high in excesses]
        first = min(trials, key=deviance)

    reach = np.concatenate([first[None], first + np.diag([1.5, 0.3])[:free, :free]])
    found = minimize(
        deviance,
        first,
        method="Nelder-Mead",
        options={"xatol": 0.02, "fatol": 0.01, "maxiter": 200, "initial_simplex": reach},
    )
    return noise_at(found.x)


@dataclass(frozen=True, slots=True, kw_only=True)
class StepScores:
    """The scores of one step's blocks, in units of their standard deviation.

    `triangle` (r, p) and `residual` (r,) are projections on orthonormal directions; direction i is that of parameter
    `direction[i]`, orthogonal to those before it.
    """

    triangle: FloatArray
    residual: FloatArray
    direction: IntArray


def project(derivative: FloatArray, residual: FloatArray) -> StepScores:
    """Project on orthonormal directions of the derivatives (n, p), in order; collinear ones are skipped."""
    basis: list[FloatArray] = []
    chosen: list[int] = []
    for i in range(derivative.shape[1]):
        column = derivative[:, i]
        rest = column.copy()
        for _ in range(2):  # twice is enough (Kahan)
            for unit in basis:
                rest -= unit * (unit @ rest)
        length = float(np.linalg.norm(rest))
        if length > _COLLINEAR * float(np.linalg.norm(column)) and length > 0.0:
            basis.append(rest / length)
            chosen.append(i)
    directions = np.array(basis).reshape(len(basis), derivative.shape[0])
    return StepScores(
        triangle=directions @ derivative, residual=directions @ residual, direction=np.array(chosen, dtype=np.int64)
    )


def score_scatter(scores: list[StepScores], bread: FloatArray) -> FloatArray:
    """Return the covariance of the sum of all scores, (p, p): each direction's variance is pooled over the steps.

    `bread` (p, p) is the covariance of the parameters if the noise were white: it determines how much of the residuals
    the fit has absorbed. If too few steps show a direction, its variance is that over all directions, at least 1.
    """
    parameters = bread.shape[0]
    found, expected, steps = np.zeros(parameters), np.zeros(parameters), np.zeros(parameters)
    squares = 0.0
    for score in scores:
        eaten = np.einsum("ij,jk,ik->i", score.triangle, bread, score.triangle)
        weight = np.take_along_axis(score.triangle, score.direction[:, None], axis=1)[:, 0] ** 2
        squares += float(score.residual @ score.residual)
        np.add.at(found, score.direction, weight * score.residual**2)
        np.add.at(expected, score.direction, weight * np.maximum(1.0 - eaten, 0.0))
        np.add.at(steps, score.direction, np.maximum(1.0 - eaten, 0.0))
    enough = steps >= _FEWEST_STEPS_FOR_SCATTER
    pooled = max(1.0, squares / max(float(steps.sum()), 1.0))
    ratio = np.full(parameters, pooled)
    ratio[enough] = np.maximum(found[enough] / expected[enough], _LEAST_RATIO)
    total = np.zeros_like(bread)
    for score in scores:
        total += (score.triangle.T * ratio[score.direction]) @ score.triangle
    return total


def autocovariances(values: FloatArray, step: IntArray, lags: int) -> FloatArray:
    """Return mean products of values that are 0 … `lags` blocks apart in one step, shape (lags+1,)."""
    result = np.zeros(lags + 1)
    for lag in range(min(lags, values.size - 1) + 1):
        together = step[lag:] == step[: step.size - lag]
        if together.any():
            result[lag] = float(np.mean((values[lag:] * values[: values.size - lag])[together]))
    return result


def likely_noises(means: LinearMeans, best: MeansNoise) -> list[tuple[MeansNoise, float]]:
    """Return walks that the data allow, each with its weight (they add up to 1): few soaks hardly determine the walk.

    The weight is the restricted likelihood with a uniform prior for q. The walks extend far above `best`: even if no
    walk is likeliest, a considerable one may still be possible.
    """
    if best.walk == 0.0:
        return [(best, 1.0)]
    logs_q = np.log(best.walk) + np.arange(-4.0, _FARTHEST_LOG_WALK, 1.0 / 3.0)
    noises = [MeansNoise(walk=float(q), excess=best.excess) for q in np.exp(logs_q)]
    logs = np.array([-0.5 * means.solve(noise)[2] for noise in noises]) + logs_q
    weights = np.exp(logs - logs.max())
    kept = np.flatnonzero(weights > 1e-4)
    weights /= weights[kept].sum()
    return [(noises[i], float(weights[i])) for i in kept]
