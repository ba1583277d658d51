"""Filters over runs of rows: those of one length together, as if each had been filtered after the other."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from benchctl.estimation import noise
from benchctl.estimation.noise import filtered, without_innovations
from benchctl_instruments.arrays import FloatArray

SECTIONS = np.array([[1.0, -1.9, 0.901, 1.0, -1.2, 0.32], [1.0, -1.0, 0.0, 1.0, -0.97, 0.0]])
NOTHING_LOST = np.eye(2 * len(SECTIONS))


def runs_of(lengths: Sequence[int], apart: int = 0) -> list[slice]:
    ends = itertools.accumulate(length + apart for length in lengths)
    return [slice(end - length - apart, end - apart) for end, length in zip(ends, lengths, strict=True)]


def one_by_one(values: FloatArray, runs: Sequence[slice]) -> FloatArray:
    white, state = np.zeros_like(values), np.zeros((len(SECTIONS), len(values), 2))
    for rows in runs:
        white[:, rows], state = scipy.signal.sosfilt(SECTIONS, values[:, rows], zi=state)
    return white


@given(st.lists(st.sampled_from([1, 2, 7, 40]), min_size=1, max_size=30), st.integers(0, 3))
def test_runs_are_filtered_as_one_after_the_other(lengths: list[int], apart: int) -> None:
    runs = runs_of(lengths, apart)
    values = np.random.default_rng(sum(lengths)).standard_normal((3, runs[-1].stop + apart))
    found = filtered(SECTIONS, values, runs, [NOTHING_LOST] * len(runs))
    assert found == pytest.approx(one_by_one(values, runs), rel=1e-9, abs=1e-9)


def test_the_state_goes_through_a_pause_as_it_is_told_to() -> None:
    runs = runs_of([5] * 6)
    values = np.random.default_rng(1).standard_normal((2, 30))
    forgotten = filtered(SECTIONS, values, runs, [np.zeros_like(NOTHING_LOST)] * 6)
    alone = np.concatenate([scipy.signal.sosfilt(SECTIONS, values[:, rows]) for rows in runs], axis=1)
    assert forgotten == pytest.approx(alone, abs=1e-12)


def test_how_many_rows_are_filtered_at_once_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = runs_of([10] * 50)
    values = np.random.default_rng(2).standard_normal((2, 500))
    at_once = filtered(SECTIONS, values, runs, [NOTHING_LOST] * 50)
    monkeypatch.setattr(noise, "_TOGETHER", 70)
    assert np.array_equal(filtered(SECTIONS, values, runs, [NOTHING_LOST] * 50), at_once)


def test_without_an_innovation_nothing_leaves_the_last_section() -> None:
    state = np.random.default_rng(3).standard_normal(2 * len(SECTIONS))
    after = without_innovations(SECTIONS) @ state
    # the row that makes the filter put out nothing is the one that leads to the same state
    begun = state.reshape(len(SECTIONS), 1, 2)
    (zero,), _ = scipy.signal.sosfilt(SECTIONS, np.zeros((1, 1)), zi=begun)
    (put_out,), ended = scipy.signal.sosfilt(SECTIONS, [[-float(zero[0])]], zi=begun)
    assert put_out[0] == pytest.approx(0.0, abs=1e-12)
    assert ended.ravel() == pytest.approx(after, abs=1e-12)
