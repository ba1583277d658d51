"""Estimate the drift of the bias from rest: its strength, and its contribution to the readings in between.

A gyro's bias is a random walk. Its strength is estimated from readings at rest, cut into pieces (restricted likelihood,
as in the calibration). The drift that is subtracted from a reading between two rests is its expectation: the optimally
weighted readings at rest before and after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.calibration.noise_model import MeansNoise, estimate, likely_noises, linear_means, walk_covariance
from benchctl.calibration.uncertainty import Mixture, dof_of_mixture
from benchctl_instruments.arrays import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Means:
    """Mean outputs in order of time within one stretch, (n,) each: V, middle time, duration, and whether at rest.

    `white_v2` is the variance of each due to noise.
    """

    output_v: FloatArray
    middle_s: FloatArray
    duration_s: FloatArray
    white_v2: FloatArray
    rest: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """Outputs without drift, and their covariance (n, n); the bias comes first if there was rest.

    `dof` are the degrees of freedom of the covariance; they are few if the walk is poorly known.
    """

    output_v: FloatArray
    covariance_v2: FloatArray
    dof: float


Noises = Sequence[tuple[MeansNoise, float]]
"""Strengths of the walk that are compatible with the rest, each with its weight; the weights add up to 1."""


def noises_of(stretches: Sequence[Means]) -> Noises:
    """Estimate the strength of the bias walk from the rest in all stretches."""
    resting = [one for one in stretches if int(one.rest.sum()) > 1]
    if not resting:
        return [(MeansNoise(walk=0.0, excess=1.0), 1.0)]
    total = sum(int(one.rest.sum()) for one in resting)
    residual, white = np.zeros(total), np.zeros(total)
    derivative, wiener = np.zeros((total, len(resting))), np.zeros((total, total))
    first = 0
    for column, one in enumerate(resting):
        part = slice(first, first + int(one.rest.sum()))
        residual[part] = one.output_v[one.rest] - one.output_v[one.rest].mean()
        white[part] = one.white_v2[one.rest]
        derivative[part, column] = 1.0
        wiener[part, part] = _walk(one)[np.ix_(one.rest, one.rest)]
        first = part.stop
    parameters = len(resting)
    means = linear_means(residual, derivative, white, wiener, np.zeros((parameters, parameters)), np.zeros(parameters))
    return likely_noises(means, estimate(means))


def white_variance(values: FloatArray) -> float:
    """Variance of one value from differences of neighbours, which drift does not increase; values of shape (n,)."""
    return float(np.mean(np.diff(values) ** 2)) / 2.0


def likeliest(noises: Noises) -> MeansNoise:
    """Return the noise with the largest weight."""
    return max(noises, key=lambda one: one[1])[0]


def settled(means: Means, noises: Noises) -> Settled:
    """Return the bias, then every reading that is not at rest, without the drift that the rest around it shows.

    Without rest the readings are returned unchanged.
    """
    parts = [_settled(means, noise) for noise, _ in noises]
    mixture = Mixture(
        weights=np.array([weight for _, weight in noises]),
        means=np.array([output_v for output_v, _ in parts]),
        covariances=np.array([covariance_v2 for _, covariance_v2 in parts]),
    )
    variances = [float(np.trace(part)) for _, part in parts]
    return Settled(
        output_v=mixture.mean, covariance_v2=mixture.covariance, dof=dof_of_mixture(mixture.weights, variances)
    )


def _walk(means: Means) -> FloatArray:
    begin_s = float(np.min(means.middle_s - 0.5 * means.duration_s))
    return walk_covariance(means.middle_s - begin_s, means.duration_s)


def _settled(means: Means, noise: MeansNoise) -> tuple[FloatArray, FloatArray]:
    """Return outputs and covariance of `settled` for one strength of the walk."""
    together = noise.walk * _walk(means) + noise.excess * np.diag(means.white_v2)
    rest, moving = np.flatnonzero(means.rest), np.flatnonzero(~means.rest)
    taken = np.zeros((moving.size + (rest.size > 0), means.output_v.size))
    taken[np.arange(moving.size) + (rest.size > 0), moving] = 1.0
    if rest.size:
        ones = np.ones(rest.size)
        at_rest = together[np.ix_(rest, rest)]
        weights = np.linalg.solve(at_rest, ones)
        bias = weights / (ones @ weights)
        taken[0, rest] = bias
        # the drift at a reading, from the readings at rest: C_xz·C_zz⁻¹·(z − bias)
        known = np.linalg.solve(at_rest, together[np.ix_(rest, moving)]).T
        taken[1:, rest] = -(known - np.outer(known @ ones, bias))
    return taken @ means.output_v, taken @ together @ taken.T
