from __future__ import annotations

import numpy as np
import pytest

from tests.benchctl.diagnosis.faults.made import STEP_V, Made, made, motion


def scale_and_bias_errors(one: Made, kept: np.ndarray, clean: np.ndarray) -> np.ndarray:
    """Errors of scale and bias by a fit to rows that are kept, in its standard errors."""
    columns = np.column_stack([clean, np.ones(clean.size)])[kept]
    wrong = (one.volts - clean)[kept]
    moved, *_ = np.linalg.lstsq(columns, wrong, rcond=None)
    variance = np.var(wrong - columns @ moved)
    return np.asarray(np.abs(moved) / np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)) * variance))


@pytest.mark.parametrize("bits", range(1, 6))
def test_lost_bits_are_counted_and_said(bits: int) -> None:
    (fault,) = made(step_v=STEP_V * 2**bits).faults().found
    assert (fault.effect, fault.parameters["bits_lost"].value) == ("adc_coarse", bits)
    assert f"{bits} bits" in fault.says or bits == 1
    assert 20.0 < fault.gain <= 1e6


@pytest.mark.parametrize("bits", [0, 1, 2])
def test_where_the_noise_reaches_over_steps_no_row_is_lost(bits: int) -> None:
    assert not made(step_v=STEP_V * 2**bits, noise_v=5e-4).faults().masked.any()


@pytest.mark.parametrize(("bits", "noise_v"), [(4, 3e-4), (5, 3e-4), (5, 6e-4)])
def test_rows_on_stairs_are_masked_and_a_fit_to_the_others_is_right(bits: int, noise_v: float) -> None:
    clean = motion()
    with_mask, without = [], []
    for seed in range(4):
        coarse = made(step_v=STEP_V * 2**bits, noise_v=noise_v, seed=seed)
        masked = coarse.faults().masked
        assert 0.1 < masked.mean() < 0.9
        assert masked[200:1300].mean() > 0.95
        with_mask.append(scale_and_bias_errors(coarse, ~masked, clean))
        without.append(scale_and_bias_errors(coarse, np.ones_like(masked), clean))
    assert np.max(with_mask) < 5.0
    assert np.max(without) > 6.0


def test_a_converter_that_is_coarse_by_its_own_is_no_fault_but_stands_on_stairs_all_the_same() -> None:
    coarse = made(step_v=32 * STEP_V, noise_v=3e-4)
    for stated in (32 * STEP_V, 0.0):
        found = coarse.faults(adc_step_v=stated)
        assert found.found == ()
        assert found.step_v == pytest.approx(32 * STEP_V, rel=1e-4)
        assert found.masked.mean() > 0.1
        assert not found.standing.any()
