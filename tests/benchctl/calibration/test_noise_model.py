"""The noise: covariance of a walk's means, restricted likelihood, projected scores, intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student

from benchctl.calibration.noise_model import (
    LinearMeans,
    MeansNoise,
    autocovariances,
    estimate,
    likely_noises,
    linear_means,
    project,
    score_scatter,
    walk_covariance,
)
from benchctl.calibration.uncertainty import Mixture, mixed


def test_the_covariance_of_a_walks_means_is_that_of_many_walks() -> None:
    rng = np.random.default_rng(1)
    walks = np.cumsum(rng.standard_normal((20_000, 300)), axis=1)
    means = np.stack([walks[:, :100].mean(1), walks[:, 100:150].mean(1), walks[:, 280:].mean(1)])
    stated = walk_covariance(np.array([50.0, 125.0, 290.0]), np.array([100.0, 50.0, 20.0]))
    assert np.cov(means) == pytest.approx(stated, rel=0.06)


def drawn(seed: int, walk: float, white: float, steps: int = 60) -> LinearMeans:
    rng = np.random.default_rng(seed)
    middle = np.cumsum(rng.uniform(50, 500, steps))
    wiener = walk_covariance(middle, np.full(steps, 20.0))
    noise = np.linalg.cholesky(walk * wiener + white * np.eye(steps)) @ rng.standard_normal(steps)
    return linear_means(
        residual=noise,
        derivative=np.stack([np.ones(steps), rng.standard_normal(steps)], axis=1),
        white=np.full(steps, white),
        wiener=wiener,
        information=np.zeros((2, 2)),
        gradient=np.zeros(2),
    )


def test_the_quick_likelihood_is_the_plain_one() -> None:
    rng = np.random.default_rng(4)
    X, r, white = rng.standard_normal((30, 2)), rng.standard_normal(30), rng.uniform(0.5, 2, 30)
    wiener = walk_covariance(np.cumsum(rng.uniform(5, 9, 30)), np.full(30, 4.0))
    prior = np.diag([0.3, 0.0])
    means = linear_means(X @ np.zeros(2) + r, X, white, wiener, prior, np.zeros(2))
    information, gradient, deviance = means.solve(MeansNoise(walk=0.2, excess=1.3))
    V = 0.2 * wiener + 1.3 * np.diag(white)
    plain = prior + X.T @ np.linalg.solve(V, X)
    assert information == pytest.approx(plain)
    assert gradient == pytest.approx(X.T @ np.linalg.solve(V, r))
    expected = np.linalg.slogdet(V)[1] + np.linalg.slogdet(plain)[1] + r @ np.linalg.solve(V, r)
    assert deviance == pytest.approx(expected - gradient @ np.linalg.solve(plain, gradient))


def test_the_restricted_likelihood_finds_walk_and_excess_without_bias() -> None:
    found = [estimate(drawn(seed, walk=4e-4, white=1e-2)) for seed in range(30)]
    assert np.mean([noise.walk for noise in found]) == pytest.approx(4e-4, rel=0.3)
    assert np.median([noise.excess for noise in found]) == pytest.approx(1.0, rel=0.2)


def test_few_steps_leave_the_excess_and_very_few_the_walk() -> None:
    assert estimate(drawn(1, 1e-4, 1e-2, steps=8)).excess == 1.0
    assert estimate(drawn(1, 1e-4, 1e-2, steps=3)) == MeansNoise(walk=0.0, excess=1.0)


def test_the_weights_of_likely_noises_add_up_to_one() -> None:
    means = drawn(3, 4e-4, 1e-2, steps=20)
    weights = [weight for _, weight in likely_noises(means, estimate(means))]
    assert sum(weights) == pytest.approx(1.0, abs=1e-12)
    assert len(weights) > 3


def test_autocovariances_do_not_look_across_steps() -> None:
    values, step = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0, 0, 1, 1])
    assert autocovariances(values, step, 1) == pytest.approx([7.5, (2 + 12) / 2])


def test_projection_keeps_all_that_the_derivatives_can_say() -> None:
    rng = np.random.default_rng(2)
    X = rng.standard_normal((200, 3))
    X = np.column_stack([X, 2 * X[:, 0]])  # collinear: no direction of its own
    e = rng.standard_normal(200)
    score = project(X, e)
    assert score.direction.tolist() == [0, 1, 2]
    assert score.triangle.T @ score.triangle == pytest.approx(X.T @ X)
    assert score.triangle.T @ score.residual == pytest.approx(X.T @ e)


def test_noise_that_comes_back_every_cycle_widens_the_scatter() -> None:
    rng = np.random.default_rng(3)
    phase = np.tile(np.linspace(0, 2 * np.pi, 50, endpoint=False), 20)
    X = np.sin(phase)[:, None]
    white, periodic = [], []
    for _ in range(60):
        white.append(project(X, rng.standard_normal(1000)))
        periodic.append(project(X, np.tile(rng.standard_normal(50), 20)))
    bread = np.linalg.inv(60 * X.T @ X)
    per_step = 60 * float(X[:, 0] @ X[:, 0])
    assert score_scatter(white, bread)[0, 0] / per_step == pytest.approx(1.0, abs=0.5)
    assert score_scatter(periodic, bread)[0, 0] / per_step == pytest.approx(20.0, rel=0.5)


def test_a_mixture_of_one_gives_the_textbook_interval() -> None:
    single = Mixture(weights=np.ones(1), means=np.array([[3.0]]), covariances=np.array([[[4.0]]]))
    low, high = single.interval(0.95, 10)
    half = 2 * student.ppf(0.975, 10)
    assert [low[0], high[0]] == pytest.approx([3 - half, 3 + half], rel=1e-9)


def test_a_mixture_is_wider_than_its_parts() -> None:
    both = Mixture(weights=np.array([0.5, 0.5]), means=np.array([[-1.0], [1.0]]), covariances=np.ones((2, 1, 1)))
    assert both.mean[0] == 0.0
    assert both.covariance[0, 0] == pytest.approx(2.0)


def test_mixtures_are_mixed_by_their_weights() -> None:
    one, other = (
        Mixture(weights=np.array([0.25, 0.75]), means=np.array([[a], [a]]), covariances=np.ones((2, 1, 1)))
        for a in (0.0, 4.0)
    )
    both = mixed([one, other], [3.0, 1.0])
    assert both.weights == pytest.approx([0.1875, 0.5625, 0.0625, 0.1875])
    assert both.mean[0] == pytest.approx(1.0)
    assert both.covariance[0, 0] == pytest.approx(1.0 + 3.0)  # within, and between: 0.75 · 1² + 0.25 · 3²
