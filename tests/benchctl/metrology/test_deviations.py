"""The Allan family, held against numbers that NIST printed and that allantools computes."""

from __future__ import annotations

from typing import get_args

import allantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.metrology.deviations import Kind, deviation
from benchctl_instruments.errors import UsageError
from tests.benchctl.metrology.noises import FloatArray, nbs14, record

SMALL_SET = np.array([892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0])
KINDS = get_args(Kind)


@pytest.mark.parametrize(
    ("kind", "printed"),
    [
        ("adev", ("2.922319e-1", "9.965736e-2", "3.897804e-2")),
        ("oadev", ("2.922319e-1", "9.159953e-2", "3.241343e-2")),
        ("mdev", ("2.922319e-1", "6.172376e-2", "2.170921e-2")),
        ("hdev", ("2.943883e-1", "1.052754e-1", "3.910860e-2")),
        ("ohdev", ("2.943883e-1", "9.581083e-2", "3.237638e-2")),
        ("tdev", ("1.687202e-1", "3.563623e-1", "1.253382e+0")),
        ("totdev", ("2.922319e-1", "9.134743e-2", "3.406530e-2")),
    ],
)
def test_the_thousand_numbers_of_nist_give_the_printed_deviations(kind: Kind, printed: tuple[str, ...]) -> None:
    found = deviation(nbs14(1000), np.array([1, 10, 100]), 1.0, kind)
    for value, digits in zip(found.tolist(), printed, strict=True):
        # the handbook cuts its last digit off at one place, and rounds it at the others
        assert value == pytest.approx(float(digits), abs=1.01e-6 * 10.0 ** int(digits.partition("e")[2]))


@pytest.mark.parametrize(
    ("kind", "printed"),
    [
        ("adev", (91.22945, 115.8082)),
        ("oadev", (91.22945, 85.95287)),
        ("mdev", (91.22945, 74.78849)),
        ("hdev", (70.80607, 116.7980)),
    ],
)
def test_the_nine_numbers_of_nist_give_the_printed_deviations(kind: Kind, printed: tuple[float, float]) -> None:
    found = deviation(SMALL_SET, np.array([1, 2]), 1.0, kind)
    assert found == pytest.approx(printed, abs=1e-4)


@pytest.mark.parametrize("noise", ["q", "n", "b", "k", "ramp"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_noise_gives_what_allantools_gives(kind: Kind, noise: str) -> None:
    chance, interval_s = np.random.default_rng(3), 0.02
    rates = np.linspace(-3.0, 5.0, 3000) if noise == "ramp" else record(chance, 3000, interval_s, **{noise: 1.0})
    factors = np.array([1, 2, 3, 10, 37, 100, 700])
    tau_s, theirs, _, _ = getattr(allantools, kind)(
        rates, rate=1.0 / interval_s, data_type="freq", taus=factors * interval_s
    )
    ours = deviation(rates, np.round(tau_s / interval_s).astype(np.int64), interval_s, kind)
    if noise == "ramp" and kind in ("hdev", "ohdev"):  # a third difference of a ramp is nothing but rounding
        assert ours == pytest.approx(np.zeros_like(ours), abs=1e-9)
    else:
        assert ours == pytest.approx(theirs, rel=1e-8)


@pytest.mark.parametrize("grid", ["octave", "decade"])
@pytest.mark.parametrize("noise", ["n", "k", "q"])
def test_a_million_samples_give_the_digits_of_allantools_on_its_grids(grid: str, noise: str) -> None:
    rates = 0.3 + record(np.random.default_rng(6), 1_000_000, 0.01, **{noise: 1.0})
    tau_s, theirs, _, _ = allantools.oadev(rates, rate=100.0, data_type="freq", taus=grid)
    ours = deviation(rates, np.round(tau_s / 0.01).astype(np.int64), 0.01)
    assert ours == pytest.approx(theirs, rel=1e-10, abs=0.0)


@pytest.mark.parametrize("kind", sorted({*KINDS} - {"totdev", "oadev"}))
def test_the_relatives_too_give_the_digits_of_allantools_of_many_samples(kind: Kind) -> None:
    rates, factors = 0.3 + record(np.random.default_rng(7), 300_000, 1.0, n=1.0), np.array([1, 7, 500, 40_000, 90_000])
    tau_s, theirs, _, _ = getattr(allantools, kind)(rates, rate=1.0, data_type="freq", taus=factors.astype(float))
    assert deviation(rates, np.round(tau_s).astype(np.int64), 1.0, kind) == pytest.approx(theirs, rel=1e-9, abs=0.0)


def test_white_noise_falls_with_the_root_of_the_averaging_time() -> None:
    rates = 0.5 * np.random.default_rng(1).standard_normal(400_000)
    factors = np.array([1, 4, 16, 64, 256])
    assert deviation(rates, factors, 0.01) == pytest.approx(0.5 / np.sqrt(factors), rel=0.05)


def test_a_ramp_has_the_deviation_of_its_definition() -> None:
    rates, factors = 0.3 * 0.1 * np.arange(5000), np.array([1, 10, 500])
    assert deviation(rates, factors, 0.1) == pytest.approx(0.3 * factors * 0.1 / np.sqrt(2.0), rel=1e-9)


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e3), st.sampled_from(KINDS))
def test_a_constant_changes_no_deviation_and_a_factor_scales_it(offset: float, factor: float, kind: Kind) -> None:
    rates, factors = nbs14(200), np.array([1, 5, 20])
    plain = deviation(rates, factors, 1.0, kind)
    assert deviation(factor * rates + offset, factors, 1.0, kind) == pytest.approx(factor * plain, rel=1e-5, abs=1e-6)


def test_a_bias_of_a_million_leaves_the_digits_of_a_long_record() -> None:
    rates = np.random.default_rng(2).standard_normal(1_000_000)
    factors = np.array([1, 1000, 100_000])
    assert deviation(rates + 1e6, factors, 1.0) == pytest.approx(deviation(rates, factors, 1.0), rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_an_averaging_time_longer_than_the_record_has_no_deviation(kind: Kind) -> None:
    assert np.isnan(deviation(nbs14(10), np.array([40]), 1.0, kind)).all()


@pytest.mark.parametrize("rates", [np.zeros(2), np.array([0.0, 1.0, np.nan]), np.zeros((3, 3))])
def test_what_is_no_series_is_refused(rates: FloatArray) -> None:
    with pytest.raises(UsageError, match="expected at least 3 finite rates in a row"):
        deviation(rates, np.array([1]), 1.0)


def test_a_factor_below_one_is_refused() -> None:
    with pytest.raises(UsageError, match="at least 1, got 0"):
        deviation(nbs14(10), np.array([1, 0]), 1.0)
