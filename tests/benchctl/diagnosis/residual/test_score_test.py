from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.signal
import scipy.sparse
import scipy.stats

from benchctl.diagnosis.residual.score_test import ScoreTest, for_entries, log_chance
from benchctl_instruments.arrays import FloatArray

N = 6000


def fitted(chance: np.random.Generator) -> FloatArray:
    return np.stack([np.ones(N), np.linspace(-1.0, 1.0, N), chance.standard_normal(N)], axis=1)


def bins(many: int) -> FloatArray:
    return (np.arange(N)[:, None] * many // N == np.arange(many)).astype(np.float64)


def everywhere() -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return np.ones(N, np.bool_)


def test_the_gain_is_that_of_a_joint_least_squares_fit() -> None:
    chance = np.random.default_rng(1)
    known, columns = fitted(chance), chance.standard_normal((N, 4))
    e = chance.standard_normal(N) + 0.1 * columns[:, 2] + 3.0 * known[:, 1]
    before = np.linalg.lstsq(known, e, rcond=None)[1][0]
    after = np.linalg.lstsq(np.hstack([known, columns]), e, rcond=None)[1][0]
    seen = ScoreTest(e, known, everywhere()).score(columns)
    assert seen.dof == 4
    assert seen.drop == pytest.approx(before - after, rel=1e-9)
    assert seen.gain == pytest.approx((N - 3) * math.log(before / after), rel=1e-9)


def test_in_white_noise_the_chances_are_those_of_chance() -> None:
    chance = np.random.default_rng(2)
    known = fitted(chance)
    found = [ScoreTest(chance.standard_normal(N), known, everywhere()).score(bins(12)) for _ in range(150)]
    # constant and slope are in the fit: one of twelve levels is no freedom any more
    assert {one.dof for one in found} == {11}
    assert np.mean([one.gain for one in found]) == pytest.approx(11.0, abs=1.2)
    chances = np.exp([one.log_p for one in found])
    # few blocks make it a little too careful, never too bold
    assert scipy.stats.kstest(chances, "uniform", alternative="greater").pvalue > 0.01
    assert 0.03 < np.mean(chances < 0.1) < 0.17


def test_sparse_and_dense_columns_say_the_same() -> None:
    chance = np.random.default_rng(3)
    left = ScoreTest(chance.standard_normal(N), fitted(chance), chance.random(N) > 0.2)
    dense, sparse = left.score(bins(9)), left.score(scipy.sparse.csr_array(bins(9)))
    single = left.score(bins(9).astype(np.float32))
    assert sparse.gain == pytest.approx(dense.gain, rel=1e-9)
    assert sparse.log_p == pytest.approx(dense.log_p, rel=1e-9)
    assert single.gain == pytest.approx(dense.gain, rel=1e-3)
    np.testing.assert_allclose(sparse.profile, dense.profile, atol=1e-12)


def test_rows_that_do_not_count_change_nothing() -> None:
    chance = np.random.default_rng(4)
    known, e, rows = fitted(chance), chance.standard_normal(N), chance.random(N) > 0.3
    spoilt = np.where(rows, e, 1e6)
    kept, other = (ScoreTest(one, known, rows).score(bins(5)) for one in (e, spoilt))
    assert other.gain == pytest.approx(kept.gain)
    assert not other.profile[~rows].any()


def test_a_planted_structure_brings_the_gain_that_its_size_says() -> None:
    chance = np.random.default_rng(5)
    known, columns = fitted(chance), bins(6)
    shape = columns[:, 2] - columns[:, 4]
    own = shape - known @ np.linalg.lstsq(known, shape, rcond=None)[0]
    size = math.sqrt(300.0 / (own @ own))
    seen = ScoreTest(chance.standard_normal(N) + size * shape, known, everywhere()).score(columns)
    assert seen.gain == pytest.approx(300.0 + seen.dof, abs=4 * 2 * math.sqrt(300.0))
    assert seen.log_p < -80.0


def test_what_the_fit_already_has_brings_nothing() -> None:
    chance = np.random.default_rng(6)
    known = fitted(chance)
    seen = ScoreTest(chance.standard_normal(N), known, everywhere()).score(
        known[:, :2] @ np.array([[1.0, 2.0], [0.5, 1.0]])
    )
    assert (seen.dof, seen.gain, seen.log_p) == (0, 0.0, 0.0)


def test_coloured_noise_is_not_taken_for_a_structure() -> None:
    chance = np.random.default_rng(7)
    known = fitted(chance)
    chances = []
    for _ in range(40):
        e = scipy.signal.lfilter(np.ones(6), [1.0], chance.standard_normal(N))
        seen = ScoreTest(e, known, everywhere()).score(bins(12))
        assert seen.inflation > 3.0
        chances.append(seen.log_p)
    assert min(chances) > math.log(1e-4)


def test_one_spike_is_no_structure() -> None:
    chance = np.random.default_rng(8)
    e = chance.standard_normal(N)
    e[1234] = 300.0
    seen = ScoreTest(e, fitted(chance), everywhere()).score(bins(50))
    assert seen.log_p > math.log(0.01)


def test_noise_that_grows_with_the_column_is_not_a_structure() -> None:
    chance = np.random.default_rng(9)
    loud = 1.0 + 6.0 * (np.arange(N) > 0.9 * N)
    chances = [
        ScoreTest(loud * chance.standard_normal(N), fitted(chance), everywhere()).score(bins(20)).log_p
        for _ in range(40)
    ]
    assert min(chances) > math.log(1e-4)


def test_chances_too_small_for_a_number_go_on_as_the_tail_does() -> None:
    assert log_chance(40.0, 2.0) == pytest.approx(-20.0)
    assert log_chance(1e6, 2.0) == pytest.approx(-5e5)
    near, far = log_chance(1400.0, 9.0), log_chance(5000.0, 9.0)
    assert math.isfinite(far)
    assert far < near < -600.0


def test_a_row_has_its_value_for_each_of_its_entries() -> None:
    values = np.array([1.0, 2.0, 3.0])
    uneven = scipy.sparse.csr_array(np.array([[5.0, 0.0], [0.0, 0.0], [6.0, 7.0]]))
    assert for_entries(uneven, values).tolist() == [1.0, 3.0, 3.0]
    even = scipy.sparse.csr_array(np.ones((3, 2)))
    assert for_entries(even, values).tolist() == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]
    assert for_entries(scipy.sparse.csr_array((0, 2)), np.zeros(0)).size == 0
