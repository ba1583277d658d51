"""Units against each other by a robust z."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.history.flags import siblings_of


def test_median_mad_and_z_by_hand() -> None:
    found = siblings_of([1.0, 2.0, 3.0, 5.0, 100.0])
    assert found is not None
    assert (found.median, found.mad, found.units, found.limit) == (3.0, 2.0, 5, 7.5)
    assert found.z(100.0) == pytest.approx(0.6745 * 97.0 / 2.0)
    assert found.is_apart(100.0, None)
    assert not found.is_apart(100.0, 98.0)  # it is not known so well
    assert not found.is_apart(3.0 + 0.99 * found.half_width, None)
    assert found.is_apart(3.0 - 1.01 * found.half_width, 0.5)


def test_too_few_units_or_equal_ones_are_not_compared() -> None:
    assert siblings_of([1.0, 2.0, 3.0, 4.0]) is None
    assert siblings_of([1.0, 1.0, 1.0, 2.0, 3.0]) is None


@pytest.mark.parametrize(("units", "most"), [(5, 0.08), (8, 0.08), (10, 0.07), (20, 0.07), (50, 0.08)])
def test_of_like_units_few_groups_have_one_that_is_called_apart(units: int, most: float) -> None:
    chance = np.random.default_rng(units)
    accused = 0
    for values in chance.standard_normal((1000, units)).tolist():
        found = siblings_of(values)
        assert found is not None
        accused += any(found.is_apart(value, None) for value in values)
    assert 0.01 < accused / 1000 < most
