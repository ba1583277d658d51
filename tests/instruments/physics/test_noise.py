from __future__ import annotations

import math

import allantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.noise import RandomWalk, WhiteNoise

SEED = np.random.SeedSequence(20)


def test_white_noise_has_its_deviation_and_no_memory() -> None:
    n = 200_000
    values = WhiteNoise(SEED).draw(n, 2.5)
    # a variance of n normal samples spreads by √(2/n), a correlation by 1/√n: five deviations
    assert values.var() == pytest.approx(2.5**2, rel=5.0 * math.sqrt(2.0 / n))
    assert abs(np.mean(values[1:] * values[:-1])) / 2.5**2 < 5.0 / math.sqrt(n)


@given(cuts=st.lists(st.integers(1, 50), min_size=1, max_size=10))
def test_white_noise_does_not_depend_on_how_it_is_drawn(cuts: list[int]) -> None:
    pieces = WhiteNoise(SEED)
    drawn = np.concatenate([pieces.draw(count, 1.0) for count in cuts])
    np.testing.assert_array_equal(drawn, WhiteNoise(SEED).draw(sum(cuts), 1.0))


def test_increments_of_the_walk_have_the_variance_of_their_time_whatever_the_spacing() -> None:
    spacings = np.tile([1e-3, 0.5, 3600.0], 30_000)
    walk = RandomWalk(SEED, 2e-3).at(np.cumsum(spacings))
    steps = np.diff(walk, prepend=0.0).reshape(-1, 3) / (2e-3 * np.sqrt([1e-3, 0.5, 3600.0]))
    n = steps.shape[0]
    assert steps.var(axis=0) == pytest.approx([1.0] * 3, rel=5.0 * math.sqrt(2.0 / n))
    np.testing.assert_allclose(np.corrcoef(steps, rowvar=False) - np.eye(3), 0.0, atol=5.0 / math.sqrt(n))


def test_the_covariance_of_the_walk_is_the_earlier_time() -> None:
    times = np.array([2.0, 5.0, 11.0])
    walks = np.array([RandomWalk(seed, 1.0).at(times) for seed in SEED.spawn(4000)])
    covariance = np.cov(walks, rowvar=False)
    np.testing.assert_allclose(covariance, np.minimum.outer(times, times), rtol=5.0 * math.sqrt(2.0 / 4000) * 2.0)


def test_the_allan_deviation_of_the_walk_rises_as_the_root_of_a_third_of_the_time() -> None:
    interval_s, strength = 0.5, 3e-3
    n = 100_000
    walk = RandomWalk(SEED, strength).at(np.arange(1, n + 1, dtype=np.float64) * interval_s)
    taus, deviations, *_ = allantools.oadev(walk, rate=1.0 / interval_s, data_type="freq", taus=[20.0, 80.0])
    # about n/m independent differences of means over m samples; the variance's relative deviation is √(2/edf)
    for tau, deviation in zip(taus, deviations, strict=True):
        edf = n * interval_s / tau
        assert deviation**2 == pytest.approx(strength**2 * tau / 3.0, rel=5.0 * math.sqrt(2.0 / edf))


def test_the_allan_deviation_of_white_noise_falls_as_the_root_of_time() -> None:
    rate_hz, n = 100.0, 200_000
    values = WhiteNoise(SEED).draw(n, 0.7)
    taus, deviations, *_ = allantools.oadev(values, rate=rate_hz, data_type="freq", taus=[0.1, 1.0])
    for tau, deviation in zip(taus, deviations, strict=True):
        edf = n / (rate_hz * tau)
        assert deviation**2 == pytest.approx(0.7**2 / (rate_hz * tau), rel=5.0 * math.sqrt(2.0 / edf))


@given(cuts=st.lists(st.integers(1, 60), min_size=1, max_size=8))
@settings(max_examples=50)
def test_the_walk_does_not_depend_on_how_it_is_asked_for(cuts: list[int]) -> None:
    times = np.cumsum(np.linspace(0.1, 2.0, sum(cuts)))
    walk = RandomWalk(SEED, 1.0)
    parts = [walk.at(part) for part in np.split(times, np.cumsum(cuts)[:-1])]
    np.testing.assert_array_equal(np.concatenate(parts), RandomWalk(SEED, 1.0).at(times))


def test_the_walk_stands_still_while_no_time_passes() -> None:
    walk = RandomWalk(SEED, 1.0)
    first, second = walk.at(np.array([4.0])), walk.at(np.array([4.0, 4.0]))
    assert first[0] == second[0] == second[1] != 0.0


def test_the_walk_cannot_be_asked_backwards() -> None:
    walk = RandomWalk(SEED, 1.0)
    walk.at(np.array([4.0]))
    with pytest.raises(UsageError, match=r"requested at 3\.9.* after 4\.0"):
        walk.at(np.array([3.9, 5.0]))
