"""The overlapping Allan deviation, held against numbers that NIST printed and that allantools computes."""

from __future__ import annotations

from collections.abc import Callable

import allantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.metrology import deviations
from benchctl.metrology.deviations import (
    compiled,
    deviation,
    integrated,
    sums_of_squares,
)
from benchctl.metrology.kernels import Kernels, by_numpy
from benchctl_instruments.errors import UsageError
from tests.benchctl.metrology.noises import FloatArray, nbs14, record

SMALL_SET = np.array([892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0])


def test_the_thousand_numbers_of_nist_give_the_printed_deviations() -> None:
    found = deviation(nbs14(1000), np.array([1, 10, 100]))
    assert found == pytest.approx([2.922319e-1, 9.159953e-2, 3.241343e-2], abs=1e-7)


def test_the_nine_numbers_of_nist_give_the_printed_deviations() -> None:
    assert deviation(SMALL_SET, np.array([1, 2])) == pytest.approx((91.22945, 85.95287), abs=1e-4)


@pytest.mark.parametrize("noise", ["q", "n", "b", "k", "ramp"])
def test_every_kind_of_noise_gives_what_allantools_gives(noise: str) -> None:
    chance, interval_s = np.random.default_rng(3), 0.02
    rates = np.linspace(-3.0, 5.0, 3000) if noise == "ramp" else record(chance, 3000, interval_s, **{noise: 1.0})
    factors = np.array([1, 2, 3, 10, 37, 100, 700])
    tau_s, theirs, _, _ = allantools.oadev(rates, rate=1.0 / interval_s, data_type="freq", taus=factors * interval_s)
    ours = deviation(rates, np.round(tau_s / interval_s).astype(np.int64))
    assert ours == pytest.approx(theirs, rel=1e-8)


@pytest.mark.parametrize("grid", ["octave", "decade"])
@pytest.mark.parametrize("noise", ["n", "k", "q"])
def test_a_million_samples_give_the_digits_of_allantools_on_its_grids(grid: str, noise: str) -> None:
    rates = 0.3 + record(np.random.default_rng(6), 1_000_000, 0.01, **{noise: 1.0})
    tau_s, theirs, _, _ = allantools.oadev(rates, rate=100.0, data_type="freq", taus=grid)
    ours = deviation(rates, np.round(tau_s / 0.01).astype(np.int64))
    assert ours == pytest.approx(theirs, rel=1e-10, abs=0.0)


def test_white_noise_falls_with_the_root_of_the_averaging_time() -> None:
    rates = 0.5 * np.random.default_rng(1).standard_normal(400_000)
    factors = np.array([1, 4, 16, 64, 256])
    assert deviation(rates, factors) == pytest.approx(0.5 / np.sqrt(factors), rel=0.05)


def test_a_ramp_has_the_deviation_of_its_definition() -> None:
    rates, factors = 0.3 * 0.1 * np.arange(5000), np.array([1, 10, 500])
    assert deviation(rates, factors) == pytest.approx(0.3 * factors * 0.1 / np.sqrt(2.0), rel=1e-9)


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e3))
def test_a_constant_changes_no_deviation_and_a_factor_scales_it(offset: float, factor: float) -> None:
    rates, factors = nbs14(200), np.array([1, 5, 20])
    plain = deviation(rates, factors)
    assert deviation(factor * rates + offset, factors) == pytest.approx(factor * plain, rel=1e-5, abs=1e-6)


def test_a_bias_of_a_million_leaves_the_digits_of_a_long_record() -> None:
    rates = np.random.default_rng(2).standard_normal(1_000_000)
    factors = np.array([1, 1000, 100_000])
    assert deviation(rates + 1e6, factors) == pytest.approx(deviation(rates, factors), rel=1e-6)


def test_an_averaging_time_longer_than_the_record_has_no_deviation() -> None:
    assert np.isnan(deviation(nbs14(10), np.array([40]))).all()


@pytest.mark.parametrize("rates", [np.zeros(2), np.array([0.0, 1.0, np.nan]), np.zeros((3, 3))])
def test_what_is_no_series_is_refused(rates: FloatArray) -> None:
    with pytest.raises(UsageError, match="expected at least 3 finite rates in a row"):
        deviation(rates, np.array([1]))


def test_a_factor_below_one_is_refused() -> None:
    with pytest.raises(UsageError, match="at least 1, got 0"):
        deviation(nbs14(10), np.array([1, 0]))


SAMPLES = 2 * (1 << 20) + 12_345  # more than two cores' pieces, and none of them even


def test_it_is_the_sum_of_the_rates_less_their_mean_from_zero_on() -> None:
    assert integrated(np.array([1.0, 2.0, 6.0]), by_numpy()) == pytest.approx([0.0, -2.0, -3.0, 0.0])


def test_a_long_sum_keeps_its_digits_across_its_pieces() -> None:
    rates = 1e3 + np.random.default_rng(1).standard_normal(SAMPLES)
    exact = np.cumsum((rates - rates.mean()).astype(np.longdouble))
    found = integrated(rates, by_numpy())
    assert found.size == SAMPLES + 1
    assert found[0] == 0.0
    assert np.max(np.abs(found[1:] - exact)) < 1e-9


@pytest.mark.parametrize("workers", [1, 3])
def test_the_number_of_cores_changes_no_bit(workers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rates = np.random.default_rng(2).standard_normal(SAMPLES)
    before = integrated(rates, by_numpy())
    monkeypatch.setattr(deviations, "cores", lambda: workers)
    assert np.array_equal(integrated(rates, by_numpy()), before)


@pytest.mark.parametrize("samples", [3, 999, 1000, 1001, 1999, 2000, 2001, 3000, 3500, 4000, 6001])
@pytest.mark.parametrize("step", [1, 3])
@pytest.mark.parametrize("made", [by_numpy, compiled])
def test_it_is_the_same_however_the_samples_fall_into_pieces(
    samples: int, step: int, made: Callable[[], Kernels], monkeypatch: pytest.MonkeyPatch
) -> None:
    rates = np.random.default_rng(samples).standard_normal(step * samples)[::step]
    monkeypatch.setattr(deviations, "_SPAN", 1000)
    found = integrated(rates, made())
    assert found[0] == 0.0
    assert np.max(np.abs(found[1:] - np.cumsum((rates - rates.mean()).astype(np.longdouble)))) < 1e-11


def test_the_rates_stay_as_they_are() -> None:
    rates = np.random.default_rng(3).standard_normal(100_000)
    kept = rates.copy()
    integrated(rates, by_numpy())
    assert np.array_equal(rates, kept)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [0, 70_000, SAMPLES - 1])
def test_one_rate_that_is_not_finite_is_refused_wherever_it_is(bad: float, place: int) -> None:
    rates = np.zeros(SAMPLES)
    rates[place] = bad
    with pytest.raises(UsageError, match=f"expected at least 3 finite rates in a row, got {SAMPLES}"):
        integrated(rates, by_numpy())


def test_infinities_that_cancel_are_refused() -> None:
    with pytest.raises(UsageError, match="finite"):
        integrated(np.array([np.inf, -np.inf, 1.0]), by_numpy())


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


def at_once(phase: FloatArray, lag: int) -> float:
    """In extended precision."""
    values = phase.astype(np.longdouble)
    for _ in range(2):
        values = values[lag:] - values[:-lag] if values.size > lag else values[:0]
    return float(values @ values)


@pytest.mark.parametrize("points", POINTS)
def test_pieces_make_up_the_whole_to_thirteen_digits(points: int, kernels: Kernels) -> None:
    phase = np.cumsum(np.random.default_rng(points).standard_normal(points))
    expected = [at_once(phase, lag) for lag in LAGS.tolist()]
    assert sums_of_squares(phase, LAGS, kernels) == pytest.approx(expected, rel=1e-13, abs=0.0)


def test_a_single_difference_is_counted_and_none_is_nothing(kernels: Kernels) -> None:
    for lag in (5, 20_000, 40_000):
        phase = np.random.default_rng(lag).standard_normal(2 * lag + 1)
        one = phase[0] - 2.0 * phase[lag] + phase[2 * lag]
        assert sums_of_squares(phase, np.array([lag]), kernels) == pytest.approx([one**2], rel=1e-10)
        assert sums_of_squares(phase[:-1], np.array([lag]), kernels).tolist() == [0.0]


def test_lags_may_come_in_any_order_and_twice(kernels: Kernels) -> None:
    phase = np.cumsum(np.random.default_rng(1).standard_normal(50_000))
    once = sums_of_squares(phase, np.array([3, 20_000]), kernels)
    assert sums_of_squares(phase, np.array([20_000, 3, 20_000]), kernels).tolist() == once[[1, 0, 1]].tolist()


@pytest.mark.parametrize("workers", [1, 3])
def test_the_number_of_cores_changes_no_bit_of_the_sums(
    workers: int, monkeypatch: pytest.MonkeyPatch, kernels: Kernels
) -> None:
    phase = np.cumsum(np.random.default_rng(2).standard_normal(2_500_000))
    lags = np.array([1, 50, 20_000, 800_000])
    before = sums_of_squares(phase, lags, kernels)
    monkeypatch.setattr(deviations, "cores", lambda: workers)
    assert sums_of_squares(phase, lags, kernels).tolist() == before.tolist()


def test_every_other_point_of_a_phase_will_do(kernels: Kernels) -> None:
    phase = np.random.default_rng(3).standard_normal(90_000)
    lags = np.array([1, 20_000])
    assert sums_of_squares(phase[::2], lags, kernels) == pytest.approx(
        sums_of_squares(phase[::2].copy(), lags, kernels), rel=1e-13
    )


@pytest.mark.parametrize(
    "lags", [[20_000, 40_000, 60_000, 120_000], [32_768, 98_304, 131_072], [17_001, 17_002, 34_002]]
)
def test_lags_that_share_their_pieces_give_what_each_gives_alone(lags: list[int], kernels: Kernels) -> None:
    phase = np.cumsum(np.random.default_rng(4).standard_normal(300_007))
    expected = [at_once(phase, lag) for lag in lags]
    assert sums_of_squares(phase, np.array(lags), kernels) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("lags", [[1, 2, 4, 8], [10, 20, 40, 100], [3, 5, 10, 20, 21], [4096, 8192, 16_384, 32_768]])
@pytest.mark.parametrize("points", [9, 25, 81, 200, 32_769, 32_800, 60_000, 131_072])
def test_lags_that_are_doubled_twice_count_every_difference_of_each(
    points: int, lags: list[int], kernels: Kernels
) -> None:
    phase = np.cumsum(np.random.default_rng(points).standard_normal(points))
    expected = [at_once(phase, lag) for lag in lags]
    assert sums_of_squares(phase, np.array(lags), kernels) == pytest.approx(expected, rel=1e-13, abs=0.0)


@pytest.mark.parametrize("lag", [1, 5, 100])
def test_where_the_longest_of_three_lags_ends_the_shorter_go_on(lag: int, kernels: Kernels) -> None:
    lags = np.array([lag, 2 * lag, 4 * lag])
    for points in (2 * lag + 1, 4 * lag, 4 * lag + 1, 8 * lag, 8 * lag + 1, 9 * lag):
        phase = np.random.default_rng(points).standard_normal(points)
        found = sums_of_squares(phase, lags, kernels)
        assert found == pytest.approx([at_once(phase, one) for one in lags.tolist()], rel=1e-13, abs=0.0)
        assert [bool(one) for one in found] == [points > 2 * one for one in lags.tolist()]
