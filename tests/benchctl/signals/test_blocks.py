"""Products summed over blocks of rows: those of a loop over the blocks, however the columns lie in memory."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from benchctl.signals.blocks import BLOCK, block_products, block_starts, gram, in_cache, step_starts


@pytest.mark.parametrize("rows", [1, BLOCK - 1, BLOCK, 3 * BLOCK, 5 * BLOCK + 7])
@pytest.mark.parametrize("order", ["C", "F"])
def test_each_block_has_the_sum_of_its_own_rows(rows: int, order: Literal["C", "F"]) -> None:
    chance = np.random.default_rng(rows)
    columns, values = np.asarray(chance.standard_normal((rows, 3)), order=order), chance.standard_normal(rows)
    own = [values[first : first + BLOCK] @ columns[first : first + BLOCK] for first in block_starts(rows).tolist()]
    np.testing.assert_allclose(block_products(columns, values), own, rtol=1e-12, atol=1e-12)


def test_without_columns_there_are_blocks_without_sums() -> None:
    assert block_products(np.zeros((130, 0)), np.ones(130)).shape == (3, 0)


def test_steps_begin_where_their_number_changes() -> None:
    assert step_starts(np.array([0, 0, 1, 1, 1, 4])).tolist() == [0, 2, 5]


@pytest.mark.parametrize("rows", [slice(0, 0), slice(5, 6), slice(3, 30_000)])
def test_rows_some_at_a_time_are_all_rows_once(rows: slice) -> None:
    taken = [row for some in in_cache(rows) for row in range(some.start, some.stop)]
    assert taken == list(range(rows.start, rows.stop))


@pytest.mark.parametrize("order", ["C", "F"])
def test_products_of_columns_with_each_other_are_those_of_all_rows(order: Literal["C", "F"]) -> None:
    columns = np.asarray(np.random.default_rng(5).standard_normal((20_001, 4)), order=order)
    np.testing.assert_allclose(gram(columns), columns.T @ columns, rtol=1e-12, atol=1e-9)
