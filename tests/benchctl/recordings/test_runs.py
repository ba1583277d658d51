"""A gap is the same to everybody who reads a recording: one missing sample, or a clock that jumps back."""

from __future__ import annotations

import numpy as np
import pytest

from benchctl.recordings.runs import gap_free, gaps, holding

INTERVAL_S = 0.01


def test_one_missing_sample_ends_a_run() -> None:
    stamps = np.delete(np.arange(10), 4) * INTERVAL_S
    assert gap_free(stamps, INTERVAL_S) == [slice(0, 4), slice(4, 9)]


def test_a_clock_that_jumps_back_ends_a_run() -> None:
    stamps = np.array([0.0, 0.01, 0.02, 0.0, 0.01])
    assert gap_free(stamps, INTERVAL_S) == [slice(0, 3), slice(3, 5)]


def test_jitter_below_half_an_interval_is_no_gap() -> None:
    stamps = np.arange(1000) * INTERVAL_S + np.random.default_rng(0).uniform(-0.24, 0.24, 1000) * INTERVAL_S
    assert gap_free(stamps, INTERVAL_S) == [slice(0, 1000)]


def test_polled_samples_may_come_later() -> None:
    steps = np.array([1.0, 3.9, 4.1, 0.2])
    assert gaps(steps, 1.0, 3.0).tolist() == [False, False, True, False]


@pytest.mark.parametrize("count", [0, 1])
def test_so_few_samples_are_one_run(count: int) -> None:
    assert gap_free(np.zeros(count), INTERVAL_S) == [slice(0, count)]


@pytest.mark.parametrize(
    ("condition", "runs"),
    [
        ([], []),
        ([True], [slice(0, 1)]),
        ([False, True, True, False, True], [slice(1, 3), slice(4, 5)]),
        ([False], []),
    ],
)
def test_a_condition_holds_in_runs(condition: list[bool], runs: list[slice]) -> None:
    assert holding(np.array(condition, dtype=bool)) == runs
