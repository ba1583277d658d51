"""Wraps of a counter, in its values alone."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.diagnosis.faults.wrapping import wraps_in

TIME_S = np.arange(0.0, 100.0, 0.01)


def test_each_run_is_continuous_with_its_own_first_value() -> None:
    course = 0.9 * np.sin(0.3 * TIME_S)
    read = np.mod(course + 0.5, 1.0) - 0.5
    runs = (slice(0, 3000), slice(3000, TIME_S.size))
    found = wraps_in(read, runs, 0.0)
    assert found is not None
    assert found.modulus == pytest.approx(1.0, abs=1e-4)
    assert found.count == np.count_nonzero(np.abs(np.diff(read)) > 0.5)
    for run in runs:
        whole = (read + found.modulus * found.turns)[run]
        assert whole - whole[0] == pytest.approx(course[run] - course[run][0], abs=1e-3)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_and_a_rail_on_either_side_are_no_counter(seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0.0, 1.0, 300)
    assert wraps_in(noise, (slice(0, noise.size),), 0.0) is None
    clipped = np.clip(noise, -0.5, 0.5)
    assert wraps_in(clipped, (slice(0, noise.size),), 0.0) is None


def test_one_jump_is_no_counter() -> None:
    read = np.where(TIME_S < 50.0, 0.01 * TIME_S, 0.01 * TIME_S - 1.0)
    assert wraps_in(read, (slice(0, read.size),), 0.0) is None
