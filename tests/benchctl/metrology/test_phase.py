"""The integrated rate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchctl.metrology import phase
from benchctl.metrology.kernels import Kernels, by_numpy, compiled
from benchctl.metrology.phase import integrated
from benchctl_instruments.errors import UsageError

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
    monkeypatch.setattr(phase, "cores", lambda: workers)
    assert np.array_equal(integrated(rates, by_numpy()), before)


@pytest.mark.parametrize("samples", [3, 999, 1000, 1001, 1999, 2000, 2001, 3000, 3500, 4000, 6001])
@pytest.mark.parametrize("step", [1, 3])
@pytest.mark.parametrize("made", [by_numpy, compiled])
def test_it_is_the_same_however_the_samples_fall_into_pieces(
    samples: int, step: int, made: Callable[[], Kernels], monkeypatch: pytest.MonkeyPatch
) -> None:
    rates = np.random.default_rng(samples).standard_normal(step * samples)[::step]
    monkeypatch.setattr(phase, "_SPAN", 1000)
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
