"""Noise that grows with the rate: its factor, how sure it is, and what is not taken for it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from benchctl.estimation.noise_model import Growing, growing

FloatArray = npt.NDArray[np.float64]
ROWS = 4000
SHARE = np.sin(np.arange(ROWS) / 170.0)
NOTHING = np.zeros(ROWS)
EVERY = np.ones(ROWS, np.bool_)


def noise(factor: float, seed: int) -> FloatArray:
    size = np.sqrt(1.0 + (factor**2 - 1.0) * SHARE**2)
    return np.asarray(size * np.random.default_rng(seed).standard_normal(ROWS))


def measured(innovation: FloatArray, known: FloatArray = NOTHING) -> Growing:
    return growing(innovation, EVERY, SHARE, known)


@pytest.mark.parametrize("factor", [1.3, 2.0, 8.0])
def test_the_factor_lies_in_its_interval_nine_times_of_ten_or_more(factor: float) -> None:
    found = [measured(noise(factor, seed)) for seed in range(100)]
    away = [abs(math.log(one.growth / (factor**2 - 1.0))) / one.log_error for one in found]
    assert sum(one < 1.96 for one in away) >= 90
    assert float(np.median([one.factor for one in found])) == pytest.approx(factor, rel=0.02)
    # an interval that is always right is too wide
    assert float(np.mean(np.square(away))) > 0.6


def test_noise_of_one_size_grows_by_chance_alone() -> None:
    gains = [measured(noise(1.0, seed)).gain for seed in range(200)]
    assert max(gains) < 12.0
    assert float(np.mean(gains)) < 1.0


def test_a_doubling_is_beyond_doubt() -> None:
    assert min(measured(noise(2.0, seed)).gain for seed in range(20)) > 50.0


def test_the_size_of_the_unit_does_not_matter() -> None:
    one, other = measured(noise(2.0, 0)), measured(1e-4 * noise(2.0, 0))
    assert other.growth == pytest.approx(one.growth, rel=1e-6)
    assert other.gain == pytest.approx(one.gain, rel=1e-6)


def test_what_changes_slowly_is_no_noise() -> None:
    slow = 5.0 * SHARE + 3.0 * SHARE**2
    away = measured(noise(2.0, 0) + slow).growth / measured(noise(2.0, 0)).growth
    assert away == pytest.approx(1.0, rel=0.01)


def test_what_the_encoder_brings_is_not_counted_as_growth() -> None:
    brought = 2.0 * SHARE**2
    x = noise(1.0, 1) * np.sqrt(1.0 + brought)
    assert measured(x).gain > 50.0
    assert measured(x, brought).gain < 8.0


def test_heavy_tails_make_it_less_sure() -> None:
    chance = np.random.default_rng(0)
    gains = [
        measured(chance.standard_t(4.0, ROWS) * np.where(chance.random(ROWS) < 0.01, 8.0, 1.0)).gain for _ in range(200)
    ]
    assert max(gains) < 12.0
    spiky = noise(2.0, 3) * np.where(chance.random(ROWS) < 0.02, 6.0, 1.0)
    assert measured(spiky).log_error > 1.5 * measured(noise(2.0, 3)).log_error


def test_rows_that_do_not_count_are_in_no_difference() -> None:
    counted = np.arange(ROWS) % 10 > 0
    x = noise(2.0, 0)
    spoilt = np.where(counted, x, 1e6)
    there, here = (growing(one, counted, SHARE, NOTHING) for one in (spoilt, x))
    assert there.growth == here.growth
    assert there.gain == here.gain


@pytest.mark.parametrize(
    ("counted", "share"), [(np.arange(ROWS) < 150, SHARE), (EVERY, np.full(ROWS, 0.5)), (~EVERY, SHARE)]
)
def test_too_few_rows_or_one_rate_tell_nothing(counted: npt.NDArray[np.bool_], share: FloatArray) -> None:
    nothing = growing(noise(2.0, 0), counted, share, NOTHING)
    assert (nothing.gain, nothing.growth, nothing.factor) == (0.0, 0.0, 1.0)
    assert nothing.log_error == math.inf
