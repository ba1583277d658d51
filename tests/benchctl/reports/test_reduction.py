import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.reports.reduction import binned, thinned


def test_few_points_are_all_drawn_but_those_that_are_not_numbers():
    x, y = np.arange(5.0), np.array([1.0, np.nan, 3.0, np.inf, 5.0])
    assert thinned(x, y).tolist() == [0, 2, 4]


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), spike=st.integers(0, 49_999))
def test_a_single_spike_among_many_points_is_drawn(seed, spike):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-100, 100, 50_000), rng.standard_normal(50_000)
    y[spike] = 50.0
    drawn = thinned(x, y)
    assert spike in drawn
    assert drawn.size <= 5300
    assert np.all(np.diff(drawn) > 0)


def test_points_in_one_place_are_thinned_too():
    drawn = thinned(np.full(20_000, 20.0), np.arange(20_000.0))
    assert 0 in drawn
    assert 19_999 in drawn
    assert drawn.size <= 5300


def test_bins_hold_the_mean_the_largest_and_the_standard_error():
    x = np.array([0.0, 0.1, 0.2, 9.9, 10.0])
    y = np.array([1.0, 2.0, -3.0, 4.0, 4.0])
    bins = binned(x, y, 10)
    np.testing.assert_allclose(bins.centre, [0.1, 9.95])
    np.testing.assert_allclose(bins.mean, [0.0, 4.0], atol=1e-15)
    np.testing.assert_allclose(bins.largest, [3.0, 4.0])
    np.testing.assert_allclose(bins.mean_se, [np.std([1, 2, -3], ddof=1) / np.sqrt(3), 0.0])


def test_a_bin_of_one_value_has_no_standard_error():
    assert np.isnan(binned(np.array([0.0, 1.0]), np.array([1.0, 2.0]), 2).mean_se).all()


def test_nothing_finite_gives_no_bins():
    assert binned(np.array([np.nan]), np.array([1.0]), 4).centre.size == 0
