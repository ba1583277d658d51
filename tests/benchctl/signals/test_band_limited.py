"""Several stretches through one filter at once."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.signals.band_limited import NARROW, differentiator, edges_hz, filtered, filtered_each, half_of
from tests.benchctl.signals.turning import RATE_HZ

LENGTHS = (1, 2, 40, 700, 3000)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_each_stretch_comes_out_as_by_itself(order: int) -> None:
    chance = np.random.default_rng(order)
    kernel = differentiator(RATE_HZ, *edges_hz(NARROW, RATE_HZ), order)
    stretches = [1e3 * place + np.cumsum(chance.standard_normal(size)) for place, size in enumerate(LENGTHS)]
    together = filtered_each(stretches, kernel)
    for values, one in zip(stretches, together, strict=True):
        alone = filtered(values, kernel)
        assert one.shape == values.shape
        np.testing.assert_allclose(one, alone, rtol=1e-9, atol=1e-9 * np.abs(alone).max() + 1e-10)


def test_no_stretch_leaks_into_the_next() -> None:
    kernel = differentiator(RATE_HZ, *edges_hz(NARROW, RATE_HZ), 1)
    still, turning = np.full(500, 77.0), 50.0 * np.arange(500) / RATE_HZ
    first, second, third = filtered_each([still, turning, still], kernel)
    assert np.abs(first).max() < 1e-7
    assert np.abs(third).max() < 1e-7
    inner = slice(half_of(RATE_HZ), -half_of(RATE_HZ))
    np.testing.assert_allclose(second[inner], 50.0, rtol=1e-6)
