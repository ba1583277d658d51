"""Drift of the bias by the rest before and after, by hand and against walks that are known."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.calibration.noise_model import MeansNoise
from benchctl.metrology.drift import Means, likeliest, noises_of, settled


def means(
    output_v: list[float], rest: list[bool], *, white_v2: float = 1e-18, long_s: float = 10.0, gap_s: float = 0.0
) -> Means:
    count = len(output_v)
    return Means(
        output_v=np.array(output_v),
        middle_s=0.5 * long_s + (long_s + gap_s) * np.arange(count),
        duration_s=np.full(count, long_s),
        white_v2=np.full(count, white_v2),
        rest=np.array(rest),
    )


def walking(walk: float) -> list[tuple[MeansNoise, float]]:
    return [(MeansNoise(walk=walk, excess=1.0), 1.0)]


def test_without_rest_the_readings_stay_as_they_are() -> None:
    one = means([0.5, 0.7, -0.2], [False] * 3, white_v2=4.0)
    found = settled(one, walking(0.0))
    assert found.output_v == pytest.approx([0.5, 0.7, -0.2])
    assert found.covariance_v2 == pytest.approx(4.0 * np.eye(3))


def test_where_the_bias_does_not_walk_its_rest_is_averaged_and_nothing_is_taken_off() -> None:
    one = means([1.0, 7.0, 3.0], [True, False, True], white_v2=2.0)
    found = settled(one, walking(0.0))
    assert found.output_v == pytest.approx([2.0, 7.0])
    assert found.covariance_v2 == pytest.approx(np.diag([1.0, 2.0]))


def test_a_straight_drift_between_two_zeros_is_taken_off_in_proportion_to_time() -> None:
    """Short readings far apart, and a walk far above the noise: the expectation between is the straight line."""
    drift = [0.0, 0.1, 0.2, 0.3, 0.4]
    rest = [True, False, False, False, True]
    level = np.where(rest, 1.0, 6.0)
    one = means((level + drift).tolist(), rest, long_s=0.01, gap_s=100.0)
    found = settled(one, walking(1e-4))
    assert found.output_v[0] == pytest.approx(1.0, abs=1e-4)  # the bias at the beginning
    assert found.output_v[1:] == pytest.approx([6.0] * 3, abs=1e-4)
    assert settled(one, walking(0.0)).output_v[1:] == pytest.approx([6.1, 6.2, 6.3])


def test_two_zeros_and_a_reading_between_have_the_weights_that_are_found_by_hand() -> None:
    r"""With q = 1 V²/s, readings of 6 s at 3, 9 and 15 s, white noise of 1 V².

    C = W + 1 with W_ii = t_i − 1 and W_ij = the earlier t: zeros [[3, 3], [3, 15]], with the reading [3, 9].
    C⁻¹·1 = [1/3, 0]: the bias is the first zero. C⁻¹·[3, 9] = [½, ½]: half of what the second zero is off is taken off.
    """
    one = means([2.0, 10.0, 4.0], [True, False, True], white_v2=1.0, long_s=6.0)
    found = settled(one, walking(1.0))
    assert found.output_v == pytest.approx([2.0, 10.0 - 0.5 * (4.0 - 2.0)])
    # of reading − ½·second + ½·first: weights [½, 1, −½] with the covariance [[3, 3, 3], [3, 9, 9], [3, 9, 15]]
    weights = np.array([[1.0, 0.0, 0.0], [0.5, 1.0, -0.5]])
    covariance = np.array([[3.0, 3.0, 3.0], [3.0, 9.0, 9.0], [3.0, 9.0, 15.0]])
    assert found.covariance_v2 == pytest.approx(weights @ covariance @ weights.T)


def test_the_covariance_is_that_of_many_walks() -> None:
    random = np.random.default_rng(5)
    rest = [True, False, False, True, False, True]
    fine_s, long_s = 0.1, 10.0
    found = []
    for _ in range(1500):
        steps = random.standard_normal(int(6 * long_s / fine_s)) * np.sqrt(1e-4 * fine_s)
        walk = np.cumsum(steps).reshape(6, -1).mean(axis=1)
        noisy = walk + random.standard_normal(6) * 0.02
        found.append(settled(means(noisy.tolist(), rest, white_v2=4e-4), walking(1e-4)))
    values = np.array([one.output_v for one in found])
    stated = found[0].covariance_v2
    assert np.cov(values.T) == pytest.approx(stated, abs=0.12 * float(np.max(np.diag(stated))))
    assert np.diag(np.cov(values.T)) == pytest.approx(np.diag(stated), rel=0.12)
    assert np.all(np.diag(stated)[1:] < 4e-4 + 1e-4 * 60.0)  # less than without the zeros


def test_strengths_that_the_rest_allows_are_weighed_and_their_differences_are_in_the_covariance() -> None:
    one = means([0.0, 5.0, 1.0], [True, False, True], white_v2=1e-6)
    quiet, loud = MeansNoise(walk=0.0, excess=1.0), MeansNoise(walk=1e3, excess=1.0)
    apart = [settled(one, [(noise, 1.0)]) for noise in (quiet, loud)]
    both = settled(one, [(quiet, 0.25), (loud, 0.75)])
    assert both.output_v == pytest.approx(0.25 * apart[0].output_v + 0.75 * apart[1].output_v)
    step = apart[0].output_v - apart[1].output_v
    within = 0.25 * apart[0].covariance_v2 + 0.75 * apart[1].covariance_v2
    assert both.covariance_v2 == pytest.approx(within + 0.25 * 0.75 * np.outer(step, step))


@pytest.mark.parametrize("walk", [1e-12, 1e-10])
def test_the_strength_of_a_walk_is_found_from_rest(walk: float) -> None:
    random = np.random.default_rng(2)
    stretches = []
    for _ in range(20):
        drift = np.cumsum(random.standard_normal(4000) * np.sqrt(walk * 0.1)).reshape(40, -1).mean(axis=1)
        noisy = drift + random.standard_normal(40) * 1e-6
        stretches.append(means(noisy.tolist(), [True] * 40, white_v2=1e-12))
    noises = noises_of(stretches)
    assert sum(weight for _, weight in noises) == pytest.approx(1.0, abs=1e-3)
    assert likeliest(noises).walk == pytest.approx(walk, rel=0.3)


def test_a_bias_that_stands_still_has_no_walk_to_speak_of() -> None:
    random = np.random.default_rng(3)
    stretches = [means((random.standard_normal(20) * 1e-6).tolist(), [True] * 20, white_v2=1e-12) for _ in range(5)]
    mean_walk = sum(weight * noise.walk for noise, weight in noises_of(stretches))
    assert mean_walk * 200.0 < 1e-12  # over a whole stretch less than one reading's noise


@pytest.mark.parametrize("rest", [[], [False, False], [True, False]])
def test_hardly_any_rest_says_nothing_of_a_walk(rest: list[bool]) -> None:
    stretches = [means([1.0] * len(rest), rest)] if rest else []
    assert noises_of(stretches) == [(MeansNoise(walk=0.0, excess=1.0), 1.0)]


def test_biases_of_different_stretches_are_no_drift() -> None:
    """A turn-on moves the bias: the walk is what happens within."""
    random = np.random.default_rng(4)
    stretches = [
        means((jump + random.standard_normal(10) * 1e-6).tolist(), [True] * 10, white_v2=1e-12)
        for jump in (0.0, 0.01, -0.02)
    ]
    assert likeliest(noises_of(stretches)).walk * 100.0 < 1e-11
