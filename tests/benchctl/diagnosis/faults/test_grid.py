from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.diagnosis.faults.grid import grid_of

OWN_V = 10.0 / 2**18


def values(step_v: float, *, offset_v: float = 0.0, seed: int = 0, rows: int = 5000) -> np.ndarray:
    codes = np.rint(np.random.default_rng(seed).normal(0.0, 1.0, rows) / step_v)
    return np.round(offset_v + codes * step_v, 6)


@given(bits=st.integers(0, 8), offset_v=st.floats(-1.0, 1.0), seed=st.integers(0, 1000))
def test_bits_that_never_move_are_counted_whatever_the_zero(bits: int, offset_v: float, seed: int) -> None:
    grid = grid_of(values(OWN_V * 2**bits, offset_v=offset_v, seed=seed), OWN_V)
    assert grid.bits_lost == bits
    assert grid.step_v == pytest.approx(OWN_V * 2**bits)


def test_a_hundredth_of_the_rows_may_be_off_the_grid_as_outliers_are_and_not_more() -> None:
    coarse, fine = values(8 * OWN_V, rows=20_000), values(OWN_V, seed=1, rows=20_000)
    coarse[:150] = fine[:150]
    assert grid_of(coarse, OWN_V).bits_lost == 3
    coarse[:400] = fine[:400]
    assert grid_of(coarse, OWN_V).bits_lost == 0


def test_an_output_that_rests_on_few_codes_nearly_always_has_lost_no_bits() -> None:
    rests = np.where(np.arange(20_000) % 2, 0.0, 8 * OWN_V)
    rests[:150] = values(OWN_V, rows=150)
    assert grid_of(np.round(rests, 6), OWN_V).bits_lost == 0


@pytest.mark.parametrize("stated", [0.0, 3.1e-4])
def test_a_step_that_is_not_stated_or_stated_wrongly_is_derived_and_no_fault(stated: float) -> None:
    grid = grid_of(values(0.01 / 7), stated)
    assert grid.step_v == pytest.approx(0.01 / 7, rel=1e-5)
    assert grid.bits_lost == 0


def test_a_calibrated_converter_still_shows_the_bits_that_it_lost() -> None:
    grid = grid_of(values(16 * OWN_V * 1.004), OWN_V)
    assert grid.step_v == pytest.approx(16 * OWN_V * 1.004, rel=1e-5)
    assert grid.bits_lost == 4


def test_values_on_no_grid_have_no_step() -> None:
    assert grid_of(np.random.default_rng(0).normal(size=5000), OWN_V).step_v == 0.0
    assert grid_of(np.zeros(0), OWN_V).step_v == 0.0


def test_a_dead_channel_has_lost_no_bits() -> None:
    assert grid_of(np.full(5000, 0.125), OWN_V).bits_lost == 0


def test_a_step_of_whole_decimals_is_seen_although_printing_has_no_finer_ones() -> None:
    for bits in (0, 2):
        grid = grid_of(np.round(values(1e-3 * 2**bits), 3), 1e-3)
        assert (grid.step_v, grid.bits_lost) == (1e-3 * 2**bits, bits)
    assert grid_of(np.round(values(1e-6), 3), 1e-5).step_v == 1e-3
