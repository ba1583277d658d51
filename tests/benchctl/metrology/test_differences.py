"""Sums of squares of differences, piece by piece, held against all of them at once."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.metrology import differences
from benchctl.metrology.differences import sums_of_squares
from benchctl.metrology.kernels import Kernels, by_numpy, compiled
from tests.benchctl.metrology.noises import FloatArray

LAGS = np.array(
    [1, 2, 7, 63, 1000, 8191, 8192, 8193, 16_383, 16_384, 16_385, 32_767, 32_768, 32_769, 50_000, 65_537, 99_000]
)
"""On both sides of what the pieces are made of."""
POINTS = [3, 4, 100, 16_385, 32_768, 32_769, 98_304, 200_001]


@pytest.fixture(params=["numpy", "numba"])
def kernels(request: pytest.FixtureRequest) -> Kernels:
    """Both kinds, where numba is installed."""
    if request.param == "numpy":
        return by_numpy()
    pytest.importorskip("numba")
    return compiled()


def at_once(phase: FloatArray, lag: int, order: int) -> float:
    """In extended precision."""
    values = phase.astype(np.longdouble)
    for _ in range(order):
        values = values[lag:] - values[:-lag] if values.size > lag else values[:0]
    return float(values @ values)


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("points", POINTS)
def test_pieces_make_up_the_whole_to_thirteen_digits(points: int, order: int, kernels: Kernels) -> None:
    phase = np.cumsum(np.random.default_rng(points).standard_normal(points))
    expected = [at_once(phase, lag, order) for lag in LAGS.tolist()]
    assert sums_of_squares(phase, LAGS, order, kernels) == pytest.approx(expected, rel=1e-13, abs=0.0)


@pytest.mark.parametrize("order", [2, 3])
def test_a_single_difference_is_counted_and_none_is_nothing(order: int, kernels: Kernels) -> None:
    for lag in (5, 20_000, 40_000):
        phase = np.random.default_rng(lag).standard_normal(order * lag + 1)
        one = sum((-1) ** k * [1, order, order * (order - 1) // 2, 1][k] * phase[k * lag] for k in range(order + 1))
        assert sums_of_squares(phase, np.array([lag]), order, kernels) == pytest.approx([one**2], rel=1e-10)
        assert sums_of_squares(phase[:-1], np.array([lag]), order, kernels).tolist() == [0.0]


def test_lags_may_come_in_any_order_and_twice(kernels: Kernels) -> None:
    phase = np.cumsum(np.random.default_rng(1).standard_normal(50_000))
    once = sums_of_squares(phase, np.array([3, 20_000]), 2, kernels)
    assert sums_of_squares(phase, np.array([20_000, 3, 20_000]), 2, kernels).tolist() == once[[1, 0, 1]].tolist()


@pytest.mark.parametrize("workers", [1, 3])
def test_the_number_of_cores_changes_no_bit(workers: int, monkeypatch: pytest.MonkeyPatch, kernels: Kernels) -> None:
    phase = np.cumsum(np.random.default_rng(2).standard_normal(2_500_000))
    lags = np.array([1, 50, 20_000, 800_000])
    before = sums_of_squares(phase, lags, 2, kernels)
    monkeypatch.setattr(differences, "cores", lambda: workers)
    assert sums_of_squares(phase, lags, 2, kernels).tolist() == before.tolist()


def test_every_other_point_of_a_phase_will_do(kernels: Kernels) -> None:
    phase = np.random.default_rng(3).standard_normal(90_000)
    lags = np.array([1, 20_000])
    assert sums_of_squares(phase[::2], lags, 2, kernels) == pytest.approx(
        sums_of_squares(phase[::2].copy(), lags, 2, kernels), rel=1e-13
    )


@pytest.mark.parametrize(
    "lags", [[20_000, 40_000, 60_000, 120_000], [32_768, 98_304, 131_072], [17_001, 17_002, 34_002]]
)
def test_lags_that_share_their_pieces_give_what_each_gives_alone(lags: list[int], kernels: Kernels) -> None:
    phase = np.cumsum(np.random.default_rng(4).standard_normal(300_007))
    expected = [at_once(phase, lag, 2) for lag in lags]
    assert sums_of_squares(phase, np.array(lags), 2, kernels) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("lags", [[1, 2, 4, 8], [10, 20, 40, 100], [3, 5, 10, 20, 21], [4096, 8192, 16_384, 32_768]])
@pytest.mark.parametrize("points", [9, 25, 81, 200, 32_769, 32_800, 60_000, 131_072])
def test_lags_that_are_doubled_twice_count_every_difference_of_each(
    points: int, lags: list[int], order: int, kernels: Kernels
) -> None:
    phase = np.cumsum(np.random.default_rng(points).standard_normal(points))
    expected = [at_once(phase, lag, order) for lag in lags]
    assert sums_of_squares(phase, np.array(lags), order, kernels) == pytest.approx(expected, rel=1e-13, abs=0.0)


@pytest.mark.parametrize("lag", [1, 5, 100])
def test_where_the_longest_of_three_lags_ends_the_shorter_go_on(lag: int, kernels: Kernels) -> None:
    lags = np.array([lag, 2 * lag, 4 * lag])
    for points in (2 * lag + 1, 4 * lag, 4 * lag + 1, 8 * lag, 8 * lag + 1, 9 * lag):
        phase = np.random.default_rng(points).standard_normal(points)
        found = sums_of_squares(phase, lags, 2, kernels)
        assert found == pytest.approx([at_once(phase, one, 2) for one in lags.tolist()], rel=1e-13, abs=0.0)
        assert [bool(one) for one in found] == [points > 2 * one for one in lags.tolist()]
