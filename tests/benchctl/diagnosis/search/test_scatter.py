"""By how much a gain varies more than white noise lets it: against noise whose colour is known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from benchctl.diagnosis.search.scatter import Scatter, scatter
from benchctl.signals.blocks import block_starts
from benchctl_instruments.arrays import FloatArray


def scatter_of(column: FloatArray, white: FloatArray, part: int = 64) -> float:
    """The scatter of what a column of any size explains at the best, over parts of so many rows."""
    explained = column * float(column @ white) / float(column @ column)
    return scatter(explained, white, np.arange(0, white.size, part))


def test_the_scatter_of_white_noise_is_one_and_that_of_coloured_noise_what_it_varies_by() -> None:
    chance = np.random.default_rng(0)
    column = np.sin(np.arange(60000) / 900.0)
    white = chance.standard_normal(60000)
    assert scatter_of(column, white) == pytest.approx(1.0, abs=0.15)
    remembers = 0.7
    coloured = scipy.signal.lfilter([1.0], [1.0, -remembers], white)
    # a slow column meets the spectrum at 0 Hz, over the variance of a row
    expected = (1.0 + remembers) / (1.0 - remembers)
    assert scatter_of(column, coloured) == pytest.approx(expected, rel=0.2)


def test_the_scatter_is_never_below_one() -> None:
    column = np.ones(6400)
    alternating = np.where(np.arange(6400) % 2 == 0, 1.0, -1.0)
    assert scatter(0.01 * column, alternating, np.arange(0, 6400, 64)) == 1.0
    assert scatter(np.zeros(6400), alternating, np.arange(0, 6400, 64)) == 1.0


def test_an_error_that_repeats_itself_in_a_step_and_differs_from_step_to_step_scatters_with_the_steps() -> None:
    chance = np.random.default_rng(1)
    steps, cycles, rows = 10, 60, 100
    column = np.tile(np.sin(2.0 * np.pi * np.arange(rows) / rows), steps * cycles)
    # the same in every cycle of a step, drawn anew for the next
    repeated = np.concatenate([np.tile(0.2 * chance.standard_normal(rows), cycles) for _ in range(steps)])
    white = chance.standard_normal(column.size) + repeated
    # a step's sum is that of its cycles, each with the same error of variance 0.04 beside noise of variance 1
    expected = (1.0 + cycles * 0.04) / 1.04
    assert scatter_of(column, white) == pytest.approx(1.0, abs=0.3)
    assert scatter_of(column, white, cycles * rows) == pytest.approx(expected, rel=0.5)


@given(st.lists(st.integers(1, 5), max_size=4), st.integers(1, 200))
def test_rows_that_come_some_blocks_at_a_time_scatter_as_all_together(blocks: list[int], last: int) -> None:
    chance = np.random.default_rng(last)
    bounds = np.cumsum([0, *(64 * many for many in blocks), last]).tolist()
    explained, white = 0.1 * chance.standard_normal(bounds[-1]), np.cumsum(chance.standard_normal(bounds[-1]))
    parts = Scatter()
    for first, stop in itertools.pairwise(bounds):
        parts.add(explained[first:stop], white[first:stop], block_starts(stop - first))
    assert parts.ratio == pytest.approx(scatter(explained, white, block_starts(white.size)))
