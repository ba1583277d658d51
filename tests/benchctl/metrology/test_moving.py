"""Sums of squares of moving averages of second differences, held against all of them at once."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.metrology.moving import sums_of_squared_averages

FACTORS = [1, 2, 5, 100, 32_768, 33_000]


@pytest.mark.parametrize("points", [3, 4, 301, 32_770, 99_001, 140_000])
def test_pieces_make_up_the_whole_to_eleven_digits(points: int) -> None:
    phase = np.cumsum(np.random.default_rng(points).standard_normal(points)).astype(np.longdouble)
    expected = []
    for m in FACTORS:
        second = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m] if points > 2 * m else phase[:0]
        sums = np.concatenate([np.zeros(1), np.cumsum(second)])
        averages = (sums[m:] - sums[:-m]) / m
        expected.append(float(averages @ averages))
    found = sums_of_squared_averages(phase.astype(np.float64), np.array(FACTORS))
    assert found == pytest.approx(expected, rel=1e-11, abs=0.0)


def test_a_ramp_of_rates_has_the_same_average_everywhere() -> None:
    phase = 0.5e-3 * np.arange(200_001.0) ** 2
    factors = np.array([10, 40_000])
    averages = phase.size - 3 * factors + 1
    assert sums_of_squared_averages(phase, factors) == pytest.approx(averages * (1e-3 * factors**2.0) ** 2, rel=1e-9)
